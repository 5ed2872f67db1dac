// The panel and the camera; the same in the live page and in the exported file.
"use strict";
const wbc = (() => {
  const panel = document.getElementById("wbc-panel");
  let info = null, tasks = [], contacts = [], phases = [];
  let time, error, eps, distance, status, text, lost;

  // Names come from the user's files, so they enter the page as text, never as markup.
  function add(parent, tag, cls, content) {
    const element = document.createElement(tag);
    if (cls) element.className = cls;
    if (content !== undefined) element.textContent = content;
    parent.appendChild(element);
    return element;
  }

  function row(cls, name, value, parent = panel) {
    const line = add(parent, "div", "row " + cls);
    if (value === undefined) add(line, "span", "dot");
    add(line, "span", "name", name).title = name;
    return value === undefined ? line : add(line, "span", "value", value);
  }

  function section(title, names, cls) {
    if (names.length) add(panel, "h2", "", title);
    // Long lists without bars stand in two columns, read downwards: a panel should not scroll.
    const two = names.length > 5 && cls !== "task out";
    const parent = two ? add(panel, "div", "two") : panel;
    if (two) parent.style.gridTemplateRows = `repeat(${Math.ceil(names.length / 2)}, auto)`;
    return names.map((name) => row(cls, name, undefined, parent));
  }

  function setup(given) {
    info = given;
    panel.replaceChildren();
    add(panel, "h1", "", info.title);
    time = row("", "time", "");
    error = row("", "object error", "");
    eps = [row("", "ε force", ""), row("", "ε moment", "")];
    if (!info.contacts.length) [error, ...eps].forEach((e) => { e.parentElement.hidden = true; });
    distance = row("", "nearest distance", "");
    status = row("", "status", "");
    phases = section("phase", info.phases, "phase");
    tasks = section("tasks, highest first", info.tasks, "task out");
    for (const line of tasks) add(add(line, "span", "bar"), "i").style.width = "0";
    contacts = section("contacts", info.contacts, "contact");
    const colors = section("forces", info.legend.map((entry) => entry[0]), "legend");
    colors.forEach((line, i) => { line.firstChild.style.background = info.legend[i][1]; });
    text = add(panel, "div", "text");
    lost = add(panel, "div", "lost");
  }

  function brief(number) { return number === null ? "–" : number.toExponential(1); }

  function show(state) {
    time.textContent = state.t.toFixed(2) + " s";
    const [position, orientation] = state.err.map(brief);
    error.textContent = state.err[0] === null ? "–" : `${position} m, ${orientation} rad`;
    state.eps.forEach((e, i) => { eps[i].textContent = brief(e); });
    distance.textContent = state.dist === null ? "–" : (1000 * state.dist).toFixed(1) + " mm";
    status.textContent = state.status || "ok";
    status.parentElement.classList.toggle("warn", state.status !== "" && state.status !== "done");
    phases.forEach((line, i) => line.classList.toggle("now", i === state.phase));
    tasks.forEach((line, i) => {
      line.classList.toggle("out", !state.in[i]);
      line.querySelector("i").style.width = 100 * state.act[i] + "%";
    });
    contacts.forEach((line, i) => {
      line.querySelector(".dot").style.background = info.colors[state.con[i]];
      line.title = ["free", "fixed", "sliding"][state.con[i]];
    });
    text.textContent = state.text;
  }

  // meshcat's scene is turned by -90 deg about x inside three.js: (x, y, z) there is (x, z, -y).
  function place(vector, x, y, z) { vector.set(x, z, -y); }

  function look(viewer) {
    const { planar, center, extent, towards } = info.view;
    const [x, y, z] = center;
    const camera = viewer.camera;
    viewer.controls.dispose();            // else two sets of controls would answer the mouse
    camera.fov = planar ? 9 : 30;         // a narrow angle from afar is nearly orthographic
    const half = Math.tan(camera.fov * Math.PI / 360);
    const { innerWidth: width, innerHeight: height } = window;
    const covered = width > 700 ? panel.getBoundingClientRect().right : 0;
    const d = 1.06 * extent / half / Math.min(1, (width - covered) / height);
    // Centred in what the panel leaves free.
    camera.setViewOffset(1, 1, -0.5 * covered / width, 0, 1, 1);
    camera.aspect = width / height;
    camera.near = d / 50;
    camera.far = 20 * d;
    place(camera.up, 0, planar ? 1 : 0, planar ? 0 : 1);
    viewer.set_camera(camera);            // the controls take over `up` when they are made
    place(viewer.controls.target, x, y, z);
    const [a, b, c] = planar ? [0, 0, 1] : towards;
    const scale = d / Math.hypot(a, b, c);
    place(camera.position, x + scale * a, y + scale * b, z + scale * c);
    camera.updateProjectionMatrix();
    viewer.controls.update();
    viewer.set_dirty();
  }

  function end(message) { if (lost) lost.textContent = message; }

  function bytes(base64) { return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)); }

  return { setup, show, look, end, bytes };
})();
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
