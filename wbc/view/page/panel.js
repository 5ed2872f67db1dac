// The panel and the camera; the same in the live page and in the exported file.
"use strict";
const wbc = (() => {
  const panel = document.getElementById("wbc-panel");
  let info = null, tasks = [], contacts = [], phases = [], time, eps, text, lost;

  // Names come from the user's files, so they enter the page as text, never as markup.
  function add(parent, tag, cls, content) {
    const element = document.createElement(tag);
    if (cls) element.className = cls;
    if (content !== undefined) element.textContent = content;
    parent.appendChild(element);
    return element;
  }

  function row(cls, name, value) {
    const line = add(panel, "div", "row " + cls);
    if (value === undefined) add(line, "span", "dot");
    add(line, "span", "name", name).title = name;
    return value === undefined ? line : add(line, "span", "value", value);
  }

  function section(title, names, cls) {
    if (names.length) add(panel, "h2", "", title);
    return names.map((name) => row(cls, name));
  }

  function setup(given) {
    info = given;
    panel.replaceChildren();
    add(panel, "h1", "", info.title);
    time = row("", "time", "");
    eps = [row("", "ε force", ""), row("", "ε moment", "")];
    phases = section("phase", info.phases, "phase");
    tasks = section("tasks, highest first", info.tasks, "task out");
    for (const line of tasks) add(add(line, "span", "bar"), "i").style.width = "0";
    contacts = section("contacts", info.contacts, "contact");
    text = add(panel, "div", "text");
    lost = add(panel, "div", "lost");
  }

  function show(state) {
    time.textContent = state.t.toFixed(2) + " s";
    state.eps.forEach((e, i) => { eps[i].textContent = e === null ? "–" : e.toExponential(1); });
    phases.forEach((line, i) => line.classList.toggle("now", i === state.phase));
    tasks.forEach((line, i) => {
      line.classList.toggle("out", !state.in[i]);
      line.querySelector("i").style.width = 100 * state.act[i] + "%";
    });
    contacts.forEach((line, i) => {
      const color = state.con[i] ? info.colors.touching : info.colors.free;
      line.querySelector(".dot").style.background = color;
    });
    text.textContent = state.text;
  }

  // meshcat's scene is turned by -90 deg about x inside three.js: (x, y, z) there is (x, z, -y).
  function place(vector, x, y, z) { vector.set(x, z, -y); }

  function look(viewer) {
    const { planar, center, extent } = info.view;
    const [x, y, z] = center;
    const camera = viewer.camera;
    viewer.controls.dispose();            // else two sets of controls would answer the mouse
    camera.fov = planar ? 9 : 38;         // a narrow angle from afar is nearly orthographic
    const half = Math.tan(camera.fov * Math.PI / 360);
    const { innerWidth: width, innerHeight: height } = window;
    const covered = width > 700 ? panel.getBoundingClientRect().right : 0;
    const d = 1.06 * extent / half / Math.min(1, (width - covered) / height);
    // Centred in what the panel leaves free, if the view is straight enough for that to be simple.
    const shift = planar ? covered * d * half / height : 0;
    camera.near = d / 50;
    camera.far = 20 * d;
    place(camera.up, 0, planar ? 1 : 0, planar ? 0 : 1);
    viewer.set_camera(camera);            // the controls take over `up` when they are made
    place(viewer.controls.target, x - shift, y, z);
    if (planar) place(camera.position, x - shift, y, z + d);
    else place(camera.position, x + 0.62 * d, y - 0.62 * d, z + 0.48 * d);
    viewer.controls.update();
    viewer.set_dirty();
  }

  function end(message) { if (lost) lost.textContent = message; }

  function bytes(base64) { return Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)); }

  return { setup, show, look, end, bytes };
})();
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
