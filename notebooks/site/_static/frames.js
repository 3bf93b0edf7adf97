// A slider below a picture of frames, one below the other, shows one of them and what it says. The button plays them;
// a loop plays by itself while it is on the screen, until a reader takes the slider, but for readers who ask for no motion.
const LOOP = 250, REST = 1000; // ms a frame, and at the end
const still = window.matchMedia("(prefers-reduced-motion: reduce)");

function movable(figure) {
  const told = JSON.parse(figure.dataset.told);
  const slider = figure.querySelector("input"), button = figure.querySelector("button");
  const last = told.values.length - 1;
  let timer = null;
  const show = () => {
    const place = Number(slider.value);
    figure.querySelector("img").style.transform = `translateY(${(-100 * place) / told.values.length}%)`;
    figure.querySelector("b").textContent = told.values[place];
    const rows = told.said[place] ? told.said[place].split("; ") : [];
    figure.querySelector("tbody").replaceChildren(...rows.map(row => {
      const line = document.createElement("tr");
      for (const part of row.split(/: (?!.*: )/)) line.append(Object.assign(document.createElement("td"), { textContent: part }));
      return line;
    }));
    slider.setAttribute("aria-valuetext", told.values[place]);
  };
  const stop = () => {
    clearTimeout(timer);
    timer = null;
    button.textContent = "\u25B6";
    button.setAttribute("aria-label", "play");
  };
  const move = () => {
    slider.value = Number(slider.value) === last ? 0 : Number(slider.value) + 1;
    show();
    timer = setTimeout(move, Number(slider.value) === last ? REST : LOOP);
  };
  const play = () => {
    stop();
    button.textContent = "\u23F8\uFE0E";
    button.setAttribute("aria-label", "stop");
    timer = setTimeout(move, LOOP);
  };
  let touched = !told.loop || still.matches;
  slider.addEventListener("input", () => { touched = true; stop(); show(); });
  button.addEventListener("click", () => { touched = true; timer === null ? play() : stop(); });
  new IntersectionObserver(([seen]) => {
    if (!seen.isIntersecting) stop();
    else if (!touched) play();
  }, { threshold: 0.5 }).observe(figure);
  show();
}

document.addEventListener("DOMContentLoaded", () => document.querySelectorAll("figure.frames").forEach(movable));
