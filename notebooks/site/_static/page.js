// What all pages do: code can be copied; on a telephone a wide picture scrolls in its box, and a wide table is a list.
const SMALL = 320; // px: a wider picture does not become smaller than it is, or than the style sheet says

function copied(pre) {
  const button = Object.assign(document.createElement("button"), { type: "button", className: "copy", textContent: "copy" });
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText(pre.textContent);
    button.textContent = "copied";
    setTimeout(() => { button.textContent = "copy"; }, 1500);
  });
  pre.parentElement.append(button);
}

function boxed(image) {
  if (image.naturalWidth <= SMALL || image.closest("table, .frames, .scrolls")) return;
  const box = Object.assign(document.createElement("span"), { className: "scrolls", tabIndex: 0 });
  box.style.setProperty("--natural", `${image.naturalWidth}px`);
  image.replaceWith(box);
  box.append(image);
}

function listed(table) {
  const heads = [...table.querySelectorAll("thead th")].map(head => head.textContent.trim());
  if (heads.length < 2 || table.closest(".frames")) return;
  for (const row of table.querySelectorAll("tbody tr")) {
    [...row.children].forEach((cell, place) => { if (heads[place]) cell.dataset.head = heads[place]; });
  }
  table.classList.add("listed");
}

document.addEventListener("DOMContentLoaded", () => {
  document.querySelectorAll("main div.highlight > pre").forEach(copied);
  document.querySelectorAll("main table.table").forEach(listed);
  for (const image of document.querySelectorAll("main article img")) {
    if (image.complete && image.naturalWidth) boxed(image);
    else image.addEventListener("load", () => boxed(image), { once: true });
  }
});
