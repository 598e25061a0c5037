// Small helpers for elements. Texts are set by textContent only: a recording's title is data, not markup.

type Attributes = Record<string, string | number | boolean | undefined>;

export function el<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: (Node | string)[]): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === false) continue;
    node.setAttribute(key, value === true ? "" : String(value));
  }
  node.append(...children);
  return node;
}

// Sets a text only if it changed: an unchanged node costs no layout.
export function setText(node: Node, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}

export function setHidden(node: HTMLElement, hidden: boolean): void {
  if (node.hidden !== hidden) node.hidden = hidden;
}

export function setClass(node: Element, name: string, on: boolean): void {
  if (node.classList.contains(name) !== on) node.classList.toggle(name, on);
}

export function setAttribute(node: Element, name: string, value: string): void {
  if (node.getAttribute(name) !== value) node.setAttribute(name, value);
}

const SVG = "http://www.w3.org/2000/svg";

// Icons of our own, on a grid of 16, drawn by `fill` and `stroke` of the styles.
const ICONS = {
  play: "M4 2.5v11l9.5-5.5z",
  pause: "M4 2.5h3v11H4zM9 2.5h3v11H9z",
  previous: "M3 2.5h2v11H3zM13 2.5v11L5.5 8z",
  next: "M11 2.5h2v11h-2zM3 2.5v11L10.5 8z",
  mark: "M4 2h1.500v12H4zM6.5 2.500l7 2.5-7 2.500z",
  loop: "M11 1l3.5 3L11 7V5H5v2.500H3V3h8zM5 15l-3.5-3L5 9v2h6V8.500h2V13H5z",
  stop: "M5 1h6l4 4v6l-4 4H5l-4-4V5z",
  skip: "M2 3v10l6-5zM8 3v10l6-5z",
  repeat: "M8 2.500V0l4 3.500L8 7V4.500A4 4 0 1 0 12 8.500h2A6 6 0 1 1 8 2.500z",
  note: "M3 2h10v8l-4 4H3zM5 5v1.300h6V5zM5 8v1.300h4V8z",
  tick: "M2 8.500l1.5-1.500L6.5 10l6-6.500L14 5l-7.5 8z",
  triangle: "M8 1.500L15 14H1zM7.2 6v4h1.600V6zM7.2 11v1.600h1.600V11z",
  full: "M2 2h5v2H4v3H2zM9 2h5v5h-2V4H9zM2 9h2v3h3v2H2zM12 9h2v5H9v-2h3z",
  dot: "M8 3.5a4.5 4.5 0 1 0 0 9a4.5 4.5 0 0 0 0-9z",
  square: "M2.5 2.5h11v11h-11z",
  table: "M2 2h12v12H2zM3.5 6v2h4V6zM8.5 6v2h4V6zM3.5 9.500v2.500h4V9.500zM8.5 9.500v2.500h4V9.500z",
} as const;

export type Icon = keyof typeof ICONS;

export function icon(name: Icon): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", ICONS[name]);
  path.setAttribute("fill-rule", "evenodd");
  svg.append(path);
  return svg;
}

export function setIcon(button: HTMLElement, name: Icon): void {
  if (button.dataset.icon === name) return;
  button.dataset.icon = name;
  const old = button.querySelector("svg");
  if (old !== null) old.replaceWith(icon(name));
  else button.prepend(icon(name));
}

// Makes a button. `label` is its accessible name and tip; `text` is what it shows beside the icon, if anything.
export function button(label: string, options: { icon?: Icon; text?: string | undefined; class?: string }, action: () => void): HTMLButtonElement {
  const node = el("button", { type: "button", class: options.class ?? "button", "aria-label": options.text === label ? undefined : label, title: label });
  if (options.icon !== undefined) setIcon(node, options.icon);
  if (options.text !== undefined) node.append(el("span", {}, options.text));
  // First the focus, then the action: a dialog gives the focus back to where it was when it opened.
  returnFocus(node);
  node.addEventListener("click", action);
  return node;
}

// Shows whether Stop has a session to stop. It is never disabled: a Stop that was not needed does no harm.
export function setStopIdle(stop: HTMLElement, word: HTMLElement, idle: boolean): void {
  setClass(stop, "idle", idle);
  setText(word, idle ? "Session over" : "Stop");
  setAttribute(stop, "title", idle ? "The session is over" : "Ends the session: zero force at once (Esc)");
}

// A control that was clicked gives the focus back, so that Space goes on to play and pause. One that was reached by Tab
// keeps it, and Space presses it.
export function returnFocus(node: HTMLElement): void {
  node.addEventListener("click", (event) => {
    if (event.detail > 0) node.blur();
  });
}
