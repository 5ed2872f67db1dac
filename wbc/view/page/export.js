// The exported file: meshcat plays the poses; the panel and the bar follow its clock.
"use strict";
(() => {
  const data = JSON.parse(document.getElementById("wbc-data").textContent);
  for (const command of data.commands) viewer.handle_command_bytearray(wbc.bytes(command));
  wbc.setup(data.info);
  wbc.look(viewer);

  const bar = document.createElement("div");
  bar.id = "wbc-player";
  bar.innerHTML = '<button></button><input type="range" min="0" step="0.001"><span class="value"></span>';
  document.body.appendChild(bar);
  const [button, slider, label] = bar.children;
  const animator = viewer.animator, times = data.times, end = times[times.length - 1];
  slider.max = end;
  button.onclick = () => (animator.playing ? animator.pause() : animator.play());
  slider.oninput = () => {
    animator.pause();
    animator.seek(Number(slider.value));
    animator.display_progress(Number(slider.value));
  };

  let shown = -1;
  function follow() {
    requestAnimationFrame(follow);
    const now = Math.min(animator.time, end);
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= now + 1e-6) low = middle; else high = middle - 1;
    }
    const mark = animator.playing ? "❚❚" : "▶";
    if (button.textContent !== mark) button.textContent = mark;
    if (low === shown) return;
    shown = low;
    wbc.show(data.states[low]);
    slider.value = now;
    label.textContent = `${times[low].toFixed(2)} / ${end.toFixed(2)} s`;
  }
  if (times.length) follow();
})();
