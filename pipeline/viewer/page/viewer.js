// A 3D view of moving bodies in WebGL 2: spheres, boxes, cylinders, capsules, ellipsoids, meshes, planes.
// createViewer(canvas, motion) -> { setMotion, setTime, look, showPaths }
"use strict";

const Viewer3D = (() => {
  const VERTEX = `#version 300 es
    in vec3 place; in vec3 normal;
    uniform mat4 model, view, projection; uniform vec3 size;
    out vec3 local, world, outward;
    void main() {
      local = place; world = (model * vec4(place * size, 1.0)).xyz;
      outward = mat3(model) * (normal / size);
      gl_Position = projection * view * vec4(world, 1.0);
    }`;
  const FRAGMENT = `#version 300 es
    precision highp float;
    in vec3 local, world, outward;
    uniform vec3 colour, eye, background; uniform float alpha, kind, reach;
    out vec4 shown;
    void main() {
      if (kind == 2.0) { shown = vec4(colour, alpha); return; }              // shadows and lines
      vec3 n = normalize(outward), seen = normalize(eye - world);
      if (dot(n, seen) < 0.0) n = -n;
      vec3 base = colour;
      if (kind == 1.0) {                                                     // ground: a grid that fades away
        vec2 cell = world.xy / max(reach / 8.0, 1e-4), line = abs(fract(cell - 0.5) - 0.5) / fwidth(cell);
        base = mix(colour * 0.86, colour, clamp(min(line.x, line.y), 0.0, 1.0));
        float far = clamp(length(world.xy - eye.xy) / (reach * 6.0), 0.0, 1.0);
        shown = vec4(mix(base, background, far * far), 1.0); return;
      }
      vec3 sides = sign(local + 1e-4);                                       // a pattern that shows how it turns
      base *= sides.x * sides.y * sides.z > 0.0 ? 1.0 : 0.72;
      vec3 sun = normalize(vec3(-0.5, -0.3, 1.2));
      float light = 0.42 + 0.2 * n.z + 0.48 * max(dot(n, sun), 0.0);
      float shine = pow(max(dot(reflect(-sun, n), seen), 0.0), 40.0) * 0.22;
      shown = vec4(base * light + shine, alpha);
    }`;

  // ---- shapes: positions and normals in the unit cube [-1, 1]
  function shell(rows, columns, at) {
    const out = [];
    for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) {
      const corner = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j], [i + 1, j + 1], [i, j + 1]];
      for (const [a, b] of corner) out.push(...at(a / rows, b / columns));
    }
    return out;
  }
  const TURN = 2 * Math.PI;
  const sphere = () => shell(24, 36, (u, v) => {
    const p = [Math.sin(Math.PI * u) * Math.cos(TURN * v), Math.sin(Math.PI * u) * Math.sin(TURN * v), Math.cos(Math.PI * u)];
    return [...p, ...p];
  });
  const cylinder = () => [
    ...shell(1, 48, (u, v) => [Math.cos(TURN * v), Math.sin(TURN * v), 1 - 2 * u, Math.cos(TURN * v), Math.sin(TURN * v), 0]),
    ...[1, -1].flatMap((z) => shell(1, 48, (u, v) => [u * Math.cos(TURN * v), u * Math.sin(TURN * v), z, 0, 0, z])),
  ];
  function box() {
    const out = [];
    for (let axis = 0; axis < 3; axis++) for (const side of [1, -1]) {
      out.push(...shell(1, 1, (u, v) => {
        const p = [0, 0, 0], n = [0, 0, 0];
        p[axis] = n[axis] = side; p[(axis + 1) % 3] = 2 * u - 1; p[(axis + 2) % 3] = 2 * v - 1;
        return [...p, ...n];
      }));
    }
    return out;
  }
  function capsule(radius, half) {                                           // half: with the caps
    const straight = half - radius;
    return shell(25, 36, (u, v) => {
      const row = Math.round(u * 25), upper = row <= 12;
      const angle = Math.PI * (upper ? row : row - 1) / 24;
      const n = [Math.sin(angle) * Math.cos(TURN * v), Math.sin(angle) * Math.sin(TURN * v), Math.cos(angle)];
      return [n[0], n[1], (radius * n[2] + (upper ? straight : -straight)) / half, n[0] / radius, n[1] / radius, n[2] / half]
        .map((x, i) => (i < 3 ? x : x * radius));
    });
  }
  const plane = () => shell(1, 1, (u, v) => [2 * u - 1, 2 * v - 1, 0, 0, 0, 1]);
  function triangles(base64) {                                               // a mesh: vertices, flat normals
    const p = floats(base64), out = [];
    for (let t = 0; t + 9 <= p.length; t += 9) {
      const [a, b, c] = [p.slice(t, t + 3), p.slice(t + 3, t + 6), p.slice(t + 6, t + 9)];
      const n = unit(cross(sub(b, a), sub(c, a)));
      for (const corner of [a, b, c]) out.push(...corner, ...n);
    }
    return out;
  }

  // ---- small linear algebra; matrices are columns, as WebGL has them
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
  function times(a, b) {
    const out = new Float32Array(16);
    for (let c = 0; c < 4; c++) for (let r = 0; r < 4; r++) for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
    return out;
  }
  function pose(p, q) {
    const [w, x, y, z] = q;
    return new Float32Array([
      1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
      2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
      2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0, p[0], p[1], p[2], 1]);
  }
  function viewOf(eye, right, up, back) {
    return new Float32Array([
      right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
      -dot(right, eye), -dot(up, eye), -dot(back, eye), 1]);
  }
  function perspective(fov, aspect, near, far) {
    const f = 1 / Math.tan((fov * Math.PI) / 360);
    return new Float32Array([f / aspect, 0, 0, 0, 0, f, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
  }
  function floats(base64) {
    const raw = atob(base64), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return new Float32Array(bytes.buffer);
  }

  function createViewer(canvas, first) {
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2, which the 3D view needs.");
    const program = gl.createProgram();
    for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source); gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "place"); gl.bindAttribLocation(program, 1, "normal");
    gl.linkProgram(program); gl.useProgram(program);
    const at = {};
    for (const name of ["model", "view", "projection", "size", "colour", "eye", "background", "alpha", "kind", "reach"]) {
      at[name] = gl.getUniformLocation(program, name);
    }
    const made = new Map();
    function geometry(key, make) {
      if (!made.has(key)) {
        const data = new Float32Array(make()), array = gl.createVertexArray();
        gl.bindVertexArray(array);
        gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
        gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
        for (const slot of [0, 1]) { gl.enableVertexAttribArray(slot); gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 24, 12 * slot); }
        made.set(key, { array, count: data.length / 6 });
      }
      return made.get(key);
    }
    const SHAPES = { sphere, ellipsoid: sphere, box, cylinder, plane };
    function meshOf(body) {
      if (body.shape === "capsule") {
        const [r, , h] = body.half;
        return geometry(`capsule ${h / r}`, () => capsule(1, h / r));
      }
      if (body.triangles) return geometry(`mesh ${body.name} ${body.triangles.length}`, () => triangles(body.triangles));
      return geometry(body.shape, SHAPES[body.shape] || box);
    }
    const lineArray = gl.createVertexArray(), lineBuffer = gl.createBuffer();
    gl.bindVertexArray(lineArray); gl.bindBuffer(gl.ARRAY_BUFFER, lineBuffer);
    gl.enableVertexAttribArray(0); gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 12, 0);

    let motion, poses, centre, reach, paths = true, time = 0, through = true;
    let orbit = { yaw: 0, pitch: 0.4, distance: 3, target: [0, 0, 0] };

    function setMotion(next) {
      const fresh = !motion;
      motion = next; poses = floats(next.poses);
      const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
      for (let i = 0; i + 7 <= poses.length; i += 7) for (let k = 0; k < 3; k++) {
        const value = poses[i + k];
        if (Number.isFinite(value)) { low[k] = Math.min(low[k], value); high[k] = Math.max(high[k], value); }
      }
      const some = low.every(Number.isFinite);
      const size = Math.max(...next.bodies.map((b) => Math.max(...b.half)), 0.01);
      if (fresh) {
        centre = some ? [0, 1, 2].map((k) => (low[k] + high[k]) / 2) : [0, 0, 0];
        reach = Math.max(some ? Math.hypot(...sub(high, low)) / 2 : 1, 3 * size);
        look(next.camera ? "camera" : "side");
      }
      draw();
    }
    function poseAt(frame, body, count) {
      const i = 7 * (frame * count + body);
      return Number.isFinite(poses[i]) ? poses.subarray(i, i + 7) : null;
    }
    function bodyAt(body, count) {
      const last = motion.frames - 1, exact = Math.min(Math.max(time * motion.rate, 0), last);
      const k = Math.floor(exact), share = exact - k;
      const a = poseAt(k, body, count), b = poseAt(Math.min(k + 1, last), body, count);
      if (!a || !b) return a;
      const sign = a[3] * b[3] + a[4] * b[4] + a[5] * b[5] + a[6] * b[6] < 0 ? -1 : 1;
      const out = [];
      for (let j = 0; j < 7; j++) out.push(a[j] + share * ((j < 3 ? 1 : sign) * b[j] - a[j]));
      const length = Math.hypot(out[3], out[4], out[5], out[6]);
      for (let j = 3; j < 7; j++) out[j] /= length;
      return out;
    }
    function camera(aspect) {
      if (through && motion.camera) {                                        // as the clip was filmed
        const c = motion.camera, r = c.rotation;
        const column = (k) => [r[k], r[3 + k], r[6 + k]];
        let fov = c.fov;
        if (aspect < c.aspect) fov = (360 / Math.PI) * Math.atan((Math.tan((fov * Math.PI) / 360) * c.aspect) / aspect);
        return { eye: c.position, right: column(0), up: column(1), back: column(2), fov };
      }
      const { yaw, pitch, distance, target } = orbit;
      const back = [-Math.sin(yaw) * Math.cos(pitch), -Math.cos(yaw) * Math.cos(pitch), Math.sin(pitch)];
      const right = [Math.cos(yaw), -Math.sin(yaw), 0];
      return { eye: [0, 1, 2].map((k) => target[k] + distance * back[k]), right, up: cross(back, right), back, fov: 40 };
    }
    function colourOf(name) {
      const text = getComputedStyle(canvas).getPropertyValue(name).trim();
      const found = /^#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})$/i.exec(text);
      return found ? found.slice(1).map((v) => parseInt(v, 16) / 255) : [0.9, 0.9, 0.9];
    }
    function item(mesh, model, size, colour, alpha = 1, kind = 0) {
      gl.uniformMatrix4fv(at.model, false, model);
      gl.uniform3fv(at.size, size); gl.uniform3fv(at.colour, colour);
      gl.uniform1f(at.alpha, alpha); gl.uniform1f(at.kind, kind);
      gl.bindVertexArray(mesh.array); gl.drawArrays(gl.TRIANGLES, 0, mesh.count);
    }
    const UPRIGHT = pose([0, 0, 0], [1, 0, 0, 0]);
    const extent = (body) => body.triangles ? [body.half[0], body.half[0], body.half[0]] : body.half;

    function draw() {
      if (!motion) return;
      const ratio = Math.min(window.devicePixelRatio || 1, 2);
      const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
      if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
      const aspect = width / height, eyes = camera(aspect), background = colourOf("--sky");
      const far = 60 * reach + 2 * Math.hypot(...sub(eyes.eye, centre));
      gl.viewport(0, 0, width, height);
      gl.clearColor(...background, 1); gl.clearStencil(0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT | gl.STENCIL_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST); gl.disable(gl.BLEND); gl.disable(gl.STENCIL_TEST);
      gl.uniformMatrix4fv(at.view, false, viewOf(eyes.eye, eyes.right, eyes.up, eyes.back));
      gl.uniformMatrix4fv(at.projection, false, perspective(eyes.fov, aspect, far / 3e4, far));
      gl.uniform3fv(at.eye, eyes.eye); gl.uniform3fv(at.background, background); gl.uniform1f(at.reach, reach);
      const floor = colourOf("--floor");
      if (motion.ground !== null) item(meshOf({ shape: "plane" }), pose([eyes.eye[0], eyes.eye[1], motion.ground], [1, 0, 0, 0]), [8 * reach, 8 * reach, 1], floor, 1, 1);
      for (const body of motion.fixed) {
        const size = body.shape === "plane" ? [1.5 * reach, 1.5 * reach, 1] : extent(body);
        const place = body.shape === "plane" ? nearest(body) : body.position;
        item(meshOf(body), pose(place, body.quaternion), size, colourOf("--fixed"));
      }
      const count = motion.bodies.length;
      const there = motion.bodies.map((body, i) => ({ body, now: bodyAt(i, count) })).filter((b) => b.now);
      if (motion.ground !== null && eyes.eye[2] > motion.ground) shadows(there, floor);
      const solid = there.filter((b) => !b.body.ghost), ghosts = there.filter((b) => b.body.ghost);
      for (const { body, now } of solid) item(meshOf(body), pose(now, now.slice(3)), extent(body), body.colour);
      if (paths) motion.bodies.forEach((body, i) => line(i, count, body));
      gl.depthFunc(gl.LEQUAL); gl.enable(gl.POLYGON_OFFSET_FILL); gl.polygonOffset(2, 2);
      for (const { body, now } of ghosts) {                                   // depth first, so that no far side shows through
        for (const visible of [false, true]) {
          gl.colorMask(visible, visible, visible, visible);
          if (visible) { gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA); }
          item(meshOf(body), pose(now, now.slice(3)), extent(body), body.colour, 0.35);
        }
        gl.disable(gl.BLEND);
      }
      gl.depthFunc(gl.LESS); gl.disable(gl.POLYGON_OFFSET_FILL);
    }
    function nearest(body) {                                                 // the point of a plane beside the motion
      const m = pose(body.position, body.quaternion), n = [m[8], m[9], m[10]], off = dot(n, sub(centre, body.position));
      return [0, 1, 2].map((k) => centre[k] - off * n[k]);
    }
    function shadows(there, floor) {                                         // bodies flattened along the light
      const sun = unit([-0.5, -0.3, 1.2]), z = motion.ground + reach * 2e-3;
      const flat = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, -sun[0] / sun[2], -sun[1] / sun[2], 0, 0, (sun[0] / sun[2]) * z, (sun[1] / sun[2]) * z, z, 1]);
      gl.enable(gl.STENCIL_TEST); gl.stencilFunc(gl.EQUAL, 0, 255); gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
      gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA); gl.depthMask(false);
      for (const { body, now } of there) {
        if (body.ghost) continue;
        item(meshOf(body), times(flat, pose(now, now.slice(3))), extent(body), floor.map((c) => c * 0.2), 0.45, 2);
      }
      gl.depthMask(true); gl.disable(gl.BLEND); gl.disable(gl.STENCIL_TEST);
    }
    function line(i, count, body) {
      const points = [];
      for (let k = 0; k < motion.frames; k++) { const p = poseAt(k, i, count); if (p) points.push(p[0], p[1], p[2]); }
      gl.bindVertexArray(lineArray); gl.bindBuffer(gl.ARRAY_BUFFER, lineBuffer);
      gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.DYNAMIC_DRAW);
      gl.uniformMatrix4fv(at.model, false, UPRIGHT); gl.uniform3fv(at.size, [1, 1, 1]);
      gl.uniform3fv(at.colour, body.colour.map((c) => (body.ghost ? 0.5 + 0.5 * c : c)));
      gl.uniform1f(at.alpha, 1); gl.uniform1f(at.kind, 2);
      gl.vertexAttrib3f(1, 0, 0, 1); gl.drawArrays(gl.LINE_STRIP, 0, points.length / 3);
    }

    function look(name) {
      through = name === "camera" && Boolean(motion.camera);
      const distance = 3.2 * reach, target = [...centre];
      if (name === "above") orbit = { yaw: 0, pitch: Math.PI / 2 - 1e-3, distance, target };
      else if (name === "side") orbit = { yaw: 0, pitch: 0.12, distance, target };
      draw();
    }
    function leaveCamera() {                                                 // go on from where the clip's camera is
      if (!through) return;
      const c = motion.camera, r = c.rotation, back = [r[2], r[5], r[8]];
      const distance = Math.max(dot(sub(c.position, centre), back), reach);
      orbit = {
        yaw: Math.atan2(-back[0], -back[1]), pitch: Math.asin(Math.min(Math.max(back[2], -1), 1)), distance,
        target: [0, 1, 2].map((k) => c.position[k] - distance * back[k]),
      };
      through = false;
    }
    const held = new Map();
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); held.set(e.pointerId, [e.clientX, e.clientY]); leaveCamera(); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => held.delete(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      const was = held.get(e.pointerId);
      if (!was) return;
      const dx = e.clientX - was[0], dy = e.clientY - was[1], spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
      const before = held.size === 2 ? spread() : 0;
      held.set(e.pointerId, [e.clientX, e.clientY]);
      if (held.size === 2) orbit.distance *= before / Math.max(spread(), 1);
      else if (e.buttons === 2 || e.shiftKey) {
        const { right, up } = camera(1), scale = orbit.distance / canvas.clientHeight;
        orbit.target = orbit.target.map((v, k) => v + scale * (dy * up[k] - dx * right[k]));
      } else {
        orbit.yaw += dx * 0.008;
        orbit.pitch = Math.min(Math.max(orbit.pitch + dy * 0.008, -1.57), 1.57);
      }
      draw();
    });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault(); leaveCamera();
      orbit.distance = Math.min(Math.max(orbit.distance * Math.exp(e.deltaY * 0.001), 0.05 * reach), 40 * reach);
      draw();
    }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
      if (!step) return;
      e.preventDefault(); leaveCamera();
      orbit.yaw += step[0]; orbit.pitch = Math.min(Math.max(orbit.pitch + step[1], -1.57), 1.57);
      draw();
    });
    new ResizeObserver(draw).observe(canvas);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
    setMotion(first);
    return {
      setMotion, look,
      setTime(t) { time = t; draw(); },
      showPaths(on) { paths = on; draw(); },
    };
  }
  return { createViewer };
})();
