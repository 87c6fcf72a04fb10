for (const view of document.querySelectorAll(".view")) {
  const slider = view.querySelector(".slider");
  const [before, after] = slider.querySelectorAll("img");
  const pictures = Object.fromEntries(
    [...view.querySelectorAll("img[data-name]")].map((i) => [i.dataset.name, i.src]));
  const bind = (select, image) => {
    const show = () => { image.src = pictures[select.value]; image.alt = select.value; };
    select.addEventListener("change", show);
    show();
  };
  const [left, right] = view.querySelectorAll("select");
  bind(left, before);
  bind(right, after);
  const move = (event) => {
    const box = slider.getBoundingClientRect();
    const share = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width));
    slider.style.setProperty("--at", 100 * share + "%");
  };
  slider.addEventListener("pointerdown", (e) => { slider.setPointerCapture(e.pointerId); move(e); });
  slider.addEventListener("pointermove", (e) => { if (e.buttons || e.pointerType === "mouse") move(e); });
}
