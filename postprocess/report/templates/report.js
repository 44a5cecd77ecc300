"use strict";
document.documentElement.classList.add("scripted");
const data = JSON.parse(document.getElementById("frames").textContent);
const [picture, slider, shown, button, values] =
  ["frame", "instant", "shown", "play", "values"].map(id => document.getElementById(id));
const INTERVAL = 90; // ms between frames while playing
let source = 0, timer = null;

// a line at the shown instant in every figure over time; a click there shows that instant
const cursors = [...document.querySelectorAll("figure[data-axis]")].map(figure => {
  const [left, right, first, last, above, below] = figure.dataset.axis.split(" ").map(Number);
  const plot = figure.querySelector(".plot"), line = plot.appendChild(document.createElement("i"));
  line.style.top = 100 * above + "%";
  line.style.bottom = 100 * below + "%";
  plot.addEventListener("click", event => {
    const part = (event.clientX - plot.getBoundingClientRect().left) / plot.clientWidth;
    const time = first + (part - left) / (right - left) * (last - first);
    const apart = data.times.map(t => Math.abs(t - time));
    stop();
    show(apart.indexOf(Math.min(...apart)));
  });
  return time => { line.style.left = 100 * (left + (time - first) / (last - first) * (right - left)) + "%"; };
});

// who has no pointer scrolls a wide figure or table by keys
for (const wide of document.querySelectorAll("figure, .scroll"))
  if (wide.scrollWidth > wide.clientWidth) wide.tabIndex = 0;

function show(index) {
  const time = data.times[index];
  slider.value = index;
  picture.src = data.frames[source][index];
  const beyond = data.end !== null && time > data.end;
  picture.classList.toggle("beyond", beyond);
  shown.textContent = time.toFixed(3) + " s" + (beyond ? ", beyond the level's numbers" : "");
  values.textContent = data.texts[index];
  slider.setAttribute("aria-valuetext", shown.textContent);
  cursors.forEach(move => move(time));
}

function stop() {
  clearInterval(timer);
  timer = null;
  button.textContent = "Play";
  button.setAttribute("aria-pressed", "false");
}

function play() {
  button.textContent = "Pause";
  button.setAttribute("aria-pressed", "true");
  timer = setInterval(() => show((Number(slider.value) + 1) % data.times.length), INTERVAL);
}

slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
button.addEventListener("click", () => (timer === null ? play() : stop()));
document.getElementById("switch").addEventListener("change", event => {
  source = Number(event.target.value);
  show(Number(slider.value));
});
show(Number(slider.value));
