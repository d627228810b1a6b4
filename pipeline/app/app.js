// The page of `dynamics app`. It shows what the server says (api/state), and asks it for everything else.
"use strict";

(() => {
  const $ = (id) => document.getElementById(id);
  const { element } = Player;
  let palette = [], limits = {}, shown = -1, state = null, polling = false;

  // ---- talking to the server
  async function ask(path, body) {
    const options = body === undefined ? {} : { method: "POST", headers: { "X-Dynamics": "1" }, body: JSON.stringify(body) };
    return read(await fetch(path, options).catch(() => { throw new Error("The server does not answer. Is `dynamics app` still running?"); }));
  }
  async function read(answer) {
    const data = await answer.json();
    if (!answer.ok) throw new Error(sentence(data.error));
    return data;
  }
  const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".");
  function say(text, good = false) {
    const line = $("message");
    line.textContent = text; line.hidden = !text; line.classList.toggle("good", good);
  }
  async function attempt(act) {
    try { await act(); } catch (error) { say(error.message); }
  }
  const anew = (act) => { say(""); return attempt(act); };   // what the visitor begins

  // ---- the job that runs
  function watch() {
    if (polling) return;
    polling = true;
    (async () => {
      for (;;) {
        const job = await ask("api/job").catch((error) => ({ state: "failed", error: error.message }));
        showJob(job);
        if (job.state !== "waiting" && job.state !== "running") {
          polling = false;
          if (job.state === "failed") say(sentence(job.error));
          if (job.state === "cancelled") say("Cancelled. Nothing of the run is left.", true);
          if (job.version !== undefined) await attempt(refresh);
          return;
        }
        await new Promise((ready) => setTimeout(ready, 300));
      }
    })();
  }
  function showJob(job) {
    const going = job.state === "waiting" || job.state === "running";
    $("job").hidden = !going;
    document.body.dataset.job = job.state;
    for (const id of ["infer", "edit", "discover", "example"]) $(id).disabled = going;
    if (!going) return;
    $("job-title").textContent = sentence(job.title).replace(/\.$/, " …");
    $("job").querySelector("progress").value = job.share;
    $("job-step").textContent = job.state === "waiting" ? `waiting: ${job.before} run${job.before === 1 ? "" : "s"} before yours` : [job.step || "starting", ...job.lines.slice(-1)].filter(Boolean).join(" · ");
  }
  async function start(path, body) { showJob(await ask(path, body)); watch(); }
  $("cancel").addEventListener("click", () => anew(() => ask("api/cancel", {})));

  // ---- a clip
  async function upload(kind, file, words = {}) {
    const most = limits[kind];
    if (file.size > most) throw new Error(`${file.name} has ${Math.round(file.size / 2 ** 20).toLocaleString("en")} MiB; at most ${Math.floor(most / 2 ** 20)} MiB are taken.`);
    const query = new URLSearchParams({ kind, name: file.name, ...words });
    return read(await fetch(`api/upload?${query}`, { method: "POST", headers: { "X-Dynamics": "1" }, body: file })
      .catch(() => { throw new Error("The upload was refused or broke off."); }));
  }
  function takeFile(file) {
    if (!file) return;
    anew(async () => {
      const words = Object.fromEntries(["start", "seconds", "fps"].map((id) => [id, $(id).value]).filter(([, value]) => value !== ""));
      showJob(await upload("clip", file, words));
      watch();
    });
  }
  $("file").addEventListener("change", (e) => { takeFile(e.target.files[0]); e.target.value = ""; });
  for (const name of ["dragover", "drop", "dragleave"]) $("drop").addEventListener(name, (e) => {
    e.preventDefault();
    $("drop").classList.toggle("over", name === "dragover");
    if (name === "drop") takeFile(e.dataTransfer.files[0]);
  });

  // ---- its bodies: outlines over the clip, and clicks
  const TOOLS = {
    look: ["Look", 0, "Play the clip, or move to a frame. Then choose what a click should do."],
    add: ["Add", 1, "Click on a body that was not found. The network looks there; it takes some seconds."],
    box: ["Add by box", 2, "Click on two opposite corners around a body that was not found."],
    drop: ["Drop", 1, "Click on a body that does not count."],
    join: ["Join", 2, "Click on two outlines that are one body."],
    split: ["Split", 2, "Click on two parts of one outline that are two bodies."],
    length: ["Known length", 2, "Click on the two ends of something of known length, in the plane of motion; enter the metres below."],
  };
  let tool = "look", clicks = [], line = null, stage = null;
  for (const [name, [title]] of Object.entries(TOOLS)) {
    const button = element("button", "", title);
    button.type = "button"; button.dataset.tool = name; button.setAttribute("role", "radio");
    button.addEventListener("click", () => choose(name));
    document.querySelector(".tools").append(button);
  }
  const undo = element("button", "", "Undo");
  undo.type = "button"; undo.id = "undo";
  undo.addEventListener("click", () => anew(() => change("undo", [])));
  document.querySelector(".tools").append(undo);
  function choose(name) {
    tool = name; clicks = [];
    for (const button of document.querySelectorAll("[data-tool]")) button.setAttribute("aria-checked", button.dataset.tool === name);
    $("hint").textContent = TOOLS[name][2];
    if (name !== "look" && stage) stage.clock.seek(stage.frame);
    drawStage();
  }
  async function change(action, points) {
    const { frame } = loaded(), answer = await ask("api/bodies", { action, frame, points });
    if (answer.state) { showJob(answer); watch(); return; }
    take(answer, frame);
  }
  function loaded() {
    if (!stage) throw new Error("The clip is still being loaded.");
    return stage;
  }
  // A whole video as a blob: the server sends no parts, without which a browser cannot move to another frame.
  async function filmOf(path) {
    const answer = await fetch(`${path}?${state.version}`);
    if (!answer.ok) throw new Error("The video is not there any more; load the page again.");
    return Player.videoOf(URL.createObjectURL(await answer.blob()));
  }
  async function showBodies(bodies, frame = 0) {
    $("bodies").hidden = !bodies;
    if (!bodies) { stage = null; $("stage-clock").replaceChildren(); return; }
    const key = JSON.stringify([state.clip, bodies.source, bodies.times]);
    $("bodies-note").textContent = [`${bodies.count} ${bodies.count === 1 ? "body" : "bodies"} in ${state.clip}, ${bodies.times[0].toFixed(2)} to ${bodies.times[bodies.times.length - 1].toFixed(2)} s.`, ...bodies.notes.map(sentence)].join(" ");
    undo.disabled = !bodies.can_undo;
    if (stage && stage.key === key) { stage.bodies = bodies; drawStage(); return; }
    const video = await filmOf("files/clip.mp4");
    if (state.bodies !== bodies) return;
    $("stage-clock").replaceChildren(); line = null; $("length-label").hidden = true;
    const canvas = $("stage"), { film } = bodies;
    canvas.width = film.panels[0].width; canvas.height = film.height;
    stage = { key, bodies, video, frame, clock: null };
    const mine = stage;
    stage.clock = Player.createClock($("stage-clock"), film.frames, film.fps, video);
    stage.clock.listen((_, now) => { if (stage === mine) { stage.frame = now; drawStage(); } });
    choose("look");
  }
  function drawStage() {
    if (!stage || stage.video.readyState < 2) return;
    const canvas = $("stage"), pen = canvas.getContext("2d"), scale = canvas.width / stage.bodies.size[0];
    pen.drawImage(stage.video, 0, 0, canvas.width, canvas.height);
    canvas.dataset.state = "shown";
    pen.lineJoin = "round"; pen.font = "600 14px system-ui, sans-serif";
    (stage.bodies.outlines[stage.frame] || []).forEach((polygons, body) => {
      let right = -1, top = 0;
      for (const points of polygons) {
        const path = new Path2D();
        for (let i = 0; i < points.length; i += 2) {
          const x = (points[i] + 0.5) * scale, y = (points[i + 1] + 0.5) * scale;
          if (x > right) [right, top] = [x, y];
          if (i) path.lineTo(x, y); else path.moveTo(x, y);
        }
        path.closePath();
        pen.strokeStyle = "#111"; pen.lineWidth = 4; pen.stroke(path);
        pen.strokeStyle = colour(body); pen.lineWidth = 2; pen.stroke(path);
      }
      if (right >= 0) label(pen, String(body + 1), Math.min(right + 4, canvas.width - 12), Math.max(top, 14), colour(body));
    });
    if (line) segment(pen, line.map((p) => p.map((v) => v * scale)));
    pen.fillStyle = "#fff"; pen.strokeStyle = "#111"; pen.lineWidth = 2;
    for (const [x, y] of clicks) { pen.beginPath(); pen.arc(x * scale, y * scale, 5, 0, 7); pen.fill(); pen.stroke(); }
  }
  function label(pen, text, x, y, fill) {
    pen.strokeStyle = "#111"; pen.lineWidth = 3; pen.strokeText(text, x, y); pen.fillStyle = fill; pen.fillText(text, x, y);
  }
  function segment(pen, [a, b]) {
    for (const [style, width] of [["#111", 5], ["#fff", 2.5]]) {
      pen.strokeStyle = style; pen.lineWidth = width; pen.beginPath(); pen.moveTo(...a); pen.lineTo(...b); pen.stroke();
    }
    label(pen, `${$("metres").value} m`, (a[0] + b[0]) / 2 + 6, (a[1] + b[1]) / 2 - 6, "#fff");
  }
  const colour = (body) => `rgb(${palette[body % palette.length].join(",")})`;
  $("metres").addEventListener("input", drawStage);
  $("stage").addEventListener("click", (e) => {
    const needed = TOOLS[tool][1], box = $("stage").getBoundingClientRect();
    if (!needed || !stage) return;
    clicks.push([((e.clientX - box.left) / box.width) * stage.bodies.size[0], ((e.clientY - box.top) / box.height) * stage.bodies.size[1]]);
    drawStage();
    if (clicks.length < needed) { $("hint").textContent = "Now the second place."; return; }
    const points = clicks, action = tool;
    clicks = [];
    $("hint").textContent = TOOLS[tool][2];
    if (action === "length") { line = points; $("length-label").hidden = false; drawStage(); return; }
    anew(() => change(action, points)).then(drawStage);
  });
  $("infer").addEventListener("click", () => anew(async () => {
    loaded().clock.pause();
    const length = line ? [...line.flat(), Number($("metres").value)] : null;
    await start("api/infer", { search: $("search").value, gravity: Number($("gravity").value), length });
  }));

  // ---- its scene
  let player = null, changes = { objects: {} }, chosen = null, sheet = null, liveFrame = 0, asking = false, again = false;
  async function showResult(result) {
    $("result").hidden = !result;
    if (!result) { player = null; $("panels").replaceChildren(); $("result-clock").replaceChildren(); $("scene3d").replaceChildren(); return; }
    $("grade").textContent = result.grade; $("grade").className = `badge ${result.grade}`;
    $("reason").textContent = result.reason;
    $("scene").textContent = result.scene;
    $("notes").replaceChildren(...result.notes.map((text) => element("li", "", text)));
    $("edit-note").textContent = result.edit_note && sentence(result.edit_note);
    const film = result.shown || result.film, video = await filmOf("files/result.mp4");
    if (state.result !== result) return;
    const fresh = !player || player.scene !== result.scene;
    $("panels").replaceChildren(); $("result-clock").replaceChildren();
    const clock = Player.createClock($("result-clock"), film.frames, film.fps, video);
    Player.createPanels($("panels"), clock, video, film.panels, film.height);
    if (fresh) {
      changes = { objects: {} }; chosen = result.objects[0].name; sheet = null;
      $("scene3d").replaceChildren();
      player = { scene: result.scene, result, clock, told: new Set() };
      player.viewer = Player.createScene3D($("scene3d"), { listen: (f) => player.told.add(f) }, result.motion);
      showObjects(); live();
    }
    player.clock = clock;
    clock.listen((time, frame) => { for (const f of player.told) f(time); drawLive(frame); });
  }
  function showObjects() {
    const names = player.result.objects.map((o, i) => {
      const button = element("button"), dot = element("span", "dot");
      dot.style.background = colour(i);
      button.type = "button"; button.setAttribute("role", "radio"); button.setAttribute("aria-checked", o.name === chosen);
      button.append(dot, o.name);
      button.addEventListener("click", () => { chosen = o.name; showObjects(); });
      return button;
    });
    $("objects").replaceChildren(...names);
    const object = player.result.objects.find((o) => o.name === chosen);
    $("sliders").replaceChildren(...object.sliders.map((s) => slider(s, (changes.objects[chosen] ||= {}))), slider(player.result.gravity, changes));
  }
  function slider(made, into) {
    const row = element("label", "slider"), input = element("input"), output = element("output");
    const to = (v) => (made.factor ? Math.log(v) : v), from = (v) => (made.factor ? Math.exp(v) : v);
    input.type = "range"; input.name = made.key; input.min = to(made.low); input.max = to(made.high);
    input.step = (to(made.high) - to(made.low)) / 400;
    input.value = to(into[made.key] ?? made.value);
    const show = () => {
      const value = into[made.key] ?? made.value;
      output.textContent = `${Number(value.toPrecision(3))} ${made.unit}`.trim();
      row.classList.toggle("moved", into[made.key] !== undefined);
    };
    input.addEventListener("input", () => {
      into[made.key] = Math.min(Math.max(from(Number(input.value)), made.low), made.high);
      show(); live();
    });
    input.addEventListener("dblclick", () => { delete into[made.key]; input.value = to(made.value); show(); live(); });
    show();
    row.append(element("span", "", made.title), input, output);
    return row;
  }
  async function live() {                                        // one question at a time; the last one counts
    if (asking) { again = true; return; }
    asking = true;
    do {
      again = false;
      try {
        const asked = performance.now(), asker = player, answer = await ask("api/live", changes), picture = new Image();
        picture.src = `data:image/jpeg;base64,${answer.sheet}`;
        await picture.decode();
        if (player !== asker) continue;                          // another clip was chosen meanwhile
        sheet = { picture, ...answer };
        if (player.viewer) player.viewer.setMotion(answer.motion);
        $("live-time").textContent = `(${((performance.now() - asked) / 1000).toFixed(2)} s)`;
        $("live").dataset.edits = answer.edits.join("; ");
        $("live").dataset.seconds = ((performance.now() - asked) / 1000).toFixed(3);
        drawLive(liveFrame);
        if (document.body.dataset.job !== "failed") say("");
      } catch (error) { say(error.message); }
    } while (again);
    asking = false;
  }
  function drawLive(frame) {
    liveFrame = frame;
    const canvas = $("live").querySelector("canvas");
    if (!sheet) return;
    if (canvas.width !== sheet.width) { canvas.width = sheet.width; canvas.height = sheet.height; }
    const x = (frame % sheet.columns) * sheet.width, y = Math.floor(frame / sheet.columns) * sheet.height;
    canvas.getContext("2d").drawImage(sheet.picture, x, y, sheet.width, sheet.height, 0, 0, sheet.width, sheet.height);
  }
  $("reset").addEventListener("click", () => { changes = { objects: {} }; showObjects(); live(); });
  $("edit").addEventListener("click", () => anew(() => start("api/edit", changes)));

  // ---- measured motion
  for (const [id, kind] of [["table", "table"], ["known", "scene"]]) {
    $(id).addEventListener("change", (e) => {
      const file = e.target.files[0];
      if (file) anew(async () => take(await upload(kind, file)));
      e.target.value = "";
    });
  }
  $("discover").addEventListener("click", () => anew(() => start("api/discover", {})));
  $("example").addEventListener("click", () => anew(() => start("api/discover", { example: true })));
  function showDiscovery() {
    $("table-name").textContent = state.table || "Table of measured motion (.csv, .parquet)";
    $("known-name").textContent = state.known || "Scene (.yaml)";
    $("discovery").hidden = !state.discovery;
    if (!state.discovery) return;
    $("sentence").textContent = state.discovery;
    $("report").src = `files/report.html?${state.version}`;
  }

  // ---- all of it
  for (const button of document.querySelectorAll("[data-tab]")) button.addEventListener("click", () => {
    for (const other of document.querySelectorAll("[data-tab]")) {
      other.setAttribute("aria-selected", other === button);
      $(`tab-${other.dataset.tab}`).hidden = other !== button;
    }
  });
  async function refresh() { take(await ask("api/state")); }
  function take(next, frame) {
    const before = state;
    state = next; palette = next.palette; limits = next.limits;
    if (!before) $("samples").append(...next.samples.map((name) => {
      const button = element("button", "sample"), picture = element("img");
      picture.src = `files/samples/${name}.jpg`; picture.alt = "";
      button.append(picture, name);
      button.type = "button"; button.dataset.sample = name;
      button.addEventListener("click", () => anew(() => start("api/sample", { name })));
      return button;
    }));
    if (shown === next.version) {                                // what is shown, or being loaded, stays the same object
      state.bodies = before.bodies; state.result = before.result;
      showDiscovery(); return;
    }
    const same = (part) => before && JSON.stringify(before[part]) === JSON.stringify(next[part]);
    shown = next.version;
    attempt(() => showBodies(next.bodies, frame));
    if (!same("result")) attempt(() => showResult(next.result));
    else if (next.result) next.result = before.result;
    if (!same("discovery") || !before || before.table !== next.table || before.known !== next.known) showDiscovery();
  }
  attempt(async () => { await refresh(); watch(); });
})();
