const shown = SHOWN, bar = document.createElement("div"), list = document.createElement("select");
bar.id = "controls";
bar.style = "position:absolute;z-index:10;left:8px;top:8px;font:14px sans-serif;color:#1d2125";
list.id = "shape";
shown.forEach((one, k) => list.add(new Option(one.name, k)));
const play = document.createElement("input"), scale = document.createElement("span");
scale.style = "margin-left:1em";
play.type = "checkbox"; play.id = "play"; play.checked = true;
const label = document.createElement("label");
label.append(play, " animate");
bar.append(list, " ", label, " ", scale);
document.body.append(bar);
let begin = performance.now(), last = -1;
function draw(now) {
  const one = shown[list.value], phase = play.checked ? ((now - begin) / 2500) % 1 : 0;
  const swing = (1 - Math.cos(2 * Math.PI * phase)) / 2;
  const time = one.first + (one.loops ? phase * (one.frames - 1) : swing * (one.frames - 1));
  scale.textContent = one.note;
  if (time !== last) { last = time; K3DInstance.setTime(time); }
}
setInterval(() => draw(performance.now()), 60);
list.onchange = () => { begin = performance.now(); };
