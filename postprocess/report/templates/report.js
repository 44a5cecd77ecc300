"use strict";
const data = JSON.parse(document.getElementById("frames").textContent);
const picture = document.getElementById("frame");
const slider = document.getElementById("instant");
const shown = document.getElementById("shown");
const button = document.getElementById("play");
const INTERVAL = 90; // ms between frames while playing
let timer = null;

function show(index) {
  picture.src = data.frames[index];
  shown.textContent = data.times[index].toFixed(3) + " s";
  slider.setAttribute("aria-valuetext", shown.textContent);
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
  timer = setInterval(() => {
    slider.value = (Number(slider.value) + 1) % data.frames.length;
    show(Number(slider.value));
  }, INTERVAL);
}

slider.addEventListener("input", () => { stop(); show(Number(slider.value)); });
button.addEventListener("click", () => (timer === null ? play() : stop()));
show(Number(slider.value));
