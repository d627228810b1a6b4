// One clock for everything that plays: the panels of one video, each on a canvas of its own, and the 3D view.
"use strict";

const Player = (() => {
  function element(tag, className, text) {
    const made = document.createElement(tag);
    if (className) made.className = className;
    if (text) made.textContent = text;
    return made;
  }

  // Controls (play, speed, scrub), and what is told of every frame. A video, where there is one, is the clock.
  function createClock(root, frames, fps, video) {
    const bar = element("div", "clock"), duration = frames / fps;
    const play = element("button", "play"), speed = element("select"), scrub = element("input"), shown = element("output");
    play.type = "button";
    scrub.type = "range"; scrub.min = 0; scrub.max = frames - 1; scrub.step = 1; scrub.value = 0;
    scrub.setAttribute("aria-label", "frame"); speed.setAttribute("aria-label", "speed");
    for (const [value, text] of [[1, "1 ×"], [0.5, "½ ×"], [0.25, "¼ ×"], [0.125, "⅛ ×"]]) {
      const option = element("option", "", text); option.value = value; speed.append(option);
    }
    bar.append(play, scrub, shown, speed); root.append(bar);
    const told = [];
    let time = 0, playing = false, last = null, usable = Boolean(video);
    const frameAt = (at) => Math.min(Math.max(Math.floor(at * fps + 1e-3), 0), frames - 1);
    function tell(at) {
      time = at;
      const frame = frameAt(time);
      scrub.value = frame;
      shown.textContent = `${(frame / fps).toFixed(2)} s`;
      for (const listener of told) listener(frame / fps, frame);
    }
    function tick(now) {
      if (!bar.isConnected) {                                      // another clock has taken its place
        if (video) { video.pause(); URL.revokeObjectURL(video.src); }
        return;
      }
      if (playing && !usable) {
        if (last !== null) tell((time + (Math.min(now - last, 100) / 1000) * Number(speed.value)) % duration);
        last = now;
      } else if (playing && frameAt(video.currentTime) !== frameAt(time)) tell(video.currentTime);
      requestAnimationFrame(tick);
    }
    function setPlaying(on) {
      playing = on; last = null; play.textContent = on ? "❚❚ Pause" : "▶ Play";
      if (!usable) return;
      if (on) video.play().catch(() => { if (usable) setPlaying(false); }); else video.pause();
    }
    function seek(frame) {
      setPlaying(false);
      if (usable) video.currentTime = (frame + 0.5) / fps;
      tell(frame / fps);
    }
    play.addEventListener("click", () => setPlaying(!playing));
    scrub.addEventListener("input", () => seek(Number(scrub.value)));
    speed.addEventListener("change", () => { if (usable) video.playbackRate = Number(speed.value); });
    if (video) {
      video.addEventListener("error", () => { usable = false; setPlaying(playing); }, { once: true });
      video.addEventListener("seeked", () => { if (!playing) tell(time); });
      video.addEventListener("loadeddata", () => tell(0), { once: true });
    }
    requestAnimationFrame(tick);
    setPlaying(!window.matchMedia("(prefers-reduced-motion: reduce)").matches);
    return {
      seek,
      pause() { setPlaying(false); },
      listen(listener) { told.push(listener); const frame = frameAt(time); listener(frame / fps, frame); },
    };
  }

  function videoOf(url) {
    const video = document.createElement("video");
    video.muted = true; video.loop = true; video.playsInline = true; video.preload = "auto"; video.src = url;
    return video;
  }

  // panels: [{ title, x, width }] of a video whose panels lie beside each other.
  function createPanels(root, clock, video, panels, height) {
    const row = element("div", "panels");
    const canvases = panels.map(({ title, width }) => {
      const figure = element("figure"), canvas = element("canvas");
      canvas.width = width; canvas.height = height; canvas.setAttribute("aria-label", title);
      figure.append(canvas, element("figcaption", "", title)); row.append(figure);
      return canvas;
    });
    root.append(row);
    video.addEventListener("error", () => row.append(element("p", "error", "This browser cannot play H.264 video.")), { once: true });
    const whole = document.createElement("canvas"), last = panels[panels.length - 1];
    whole.width = last.x + last.width; whole.height = height;
    clock.listen(() => {
      if (video.readyState < 2) return;
      row.dataset.state = "shown";
      whole.getContext("2d").drawImage(video, 0, 0);           // once: a video may go on between two drawings
      canvases.forEach((canvas, i) => canvas.getContext("2d").drawImage(whole, panels[i].x, 0, panels[i].width, height, 0, 0, panels[i].width, height));
    });
    return row;
  }

  function createScene3D(root, clock, motion) {
    const figure = element("figure", "scene3d"), canvas = element("canvas"), bar = element("div", "views");
    canvas.tabIndex = 0; canvas.setAttribute("aria-label", "3D replay");
    figure.append(canvas, bar); root.append(figure);
    let viewer;
    try {
      viewer = Viewer3D.createViewer(canvas, motion);
    } catch (error) {
      canvas.remove(); figure.append(element("p", "error", error.message));
      return null;
    }
    const views = [...(motion.camera ? [["camera", "The clip's camera"]] : []), ["above", "From above"], ["side", "From the side"]];
    for (const [name, title] of views) {
      const button = element("button", "", title);
      button.type = "button"; button.addEventListener("click", () => viewer.look(name)); bar.append(button);
    }
    const label = element("label", "", " Paths"), paths = element("input");
    paths.type = "checkbox"; paths.checked = true; label.prepend(paths);
    paths.addEventListener("change", () => viewer.showPaths(paths.checked));
    bar.append(label, element("span", "hint", "drag to turn · shift-drag to move · wheel to zoom"));
    clock.listen((time) => viewer.setTime(time));
    return viewer;
  }

  return { createClock, createPanels, createScene3D, element, videoOf };
})();
