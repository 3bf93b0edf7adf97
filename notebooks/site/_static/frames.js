// A slider below a picture of frames, one below the other, shows one of them and what it says.
document.addEventListener("DOMContentLoaded", () => {
  for (const figure of document.querySelectorAll("figure.frames")) {
    const told = JSON.parse(figure.dataset.told);
    const slider = figure.querySelector("input");
    const show = () => {
      const place = Number(slider.value);
      figure.querySelector("img").style.transform = `translateY(${(-100 * place) / told.values.length}%)`;
      figure.querySelector("output").textContent = `${told.values[place]}. ${told.said[place]}`;
      slider.setAttribute("aria-valuetext", told.values[place]);
    };
    slider.addEventListener("input", show);
    show();
  }
});
