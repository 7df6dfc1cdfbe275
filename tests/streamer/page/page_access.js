// What of a page cannot be read, named or reached; see test_page.py.
() => {
  const luminance = (rgb) => rgb.map((part) => part / 255).map((part) => (part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4))
    .reduce((sum, part, index) => sum + part * [0.2126, 0.7152, 0.0722][index], 0);
  // Any colour of CSS, mixed ones too, as it is drawn.
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 1;
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const drawn = (...colours) => {
    for (const colour of colours) { context.fillStyle = colour; context.fillRect(0, 0, 1, 1); }
    return [...context.getImageData(0, 0, 1, 1).data].slice(0, 3);
  };
  const grounds = (element) => (element ? [...grounds(element.parentElement), getComputedStyle(element).backgroundColor] : ["white"]);
  const found = { contrast: [], names: [], small: [], edges: [], unreachable: [] };
  for (const element of document.querySelectorAll("body *")) {
    const style = getComputedStyle(element), box = element.getBoundingClientRect();
    if (!box.width || !box.height || style.visibility === "hidden" || element.classList.contains("hidden")) continue;
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    const says = element.tagName + "#" + element.id + " " + (element.textContent || "").trim().slice(0, 30);
    if (own && element.tagName !== "OPTION") {
      const ground = grounds(element), [a, b] = [luminance(drawn(...ground, style.color)), luminance(drawn(...ground))];
      const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
      const large = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.66 && style.fontWeight >= 700);
      if (ratio < (large ? 3 : 4.5)) found.contrast.push(`${says}: ${ratio.toFixed(2)}`);
    }
    if (element.matches("button, input, select, summary, a, [tabindex]")) {
      const label = element.labels?.length ? element.labels[0].textContent : "";
      if (!(element.getAttribute("aria-label") || label || element.textContent).trim()) found.names.push(says);
      const target = element.matches("input[type=checkbox], input[type=radio]") ? element.labels[0].getBoundingClientRect() : box;
      if (element.tagName !== "A" && Math.min(target.width, target.height) < 24) found.small.push(`${says}: ${target.width} x ${target.height}`);
      if (element.matches("input:not([type=checkbox], [type=radio]), select, button, #stick:not(.off)")) {
        const ground = grounds(element.parentElement), under = luminance(drawn(...ground));
        const apart = [style.borderTopColor, style.backgroundColor].map((colour) => luminance(drawn(...ground, colour)))
          .map((own) => (Math.max(own, under) + 0.05) / (Math.min(own, under) + 0.05));
        if (Math.max(...apart) < 3) found.edges.push(`${says}: ${apart.map((one) => one.toFixed(2))}`);
      }
      if (element.tabIndex < 0) found.unreachable.push(says);
    }
  }
  return found;
}
