// Dialogs: the table of keys, the table of values, a mark's text.
import { button, el, setText } from "./dom";
import { cellText, clock, columnWord, decimals, quantity, shownAs } from "./format";
import { KEY_TABLE, lettersOn, setLetters } from "./keys";
import type { Model } from "./model";

// Distance of a dialog from Stop and from the edges of the window [CSS px].
const GAP = 8;

export interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

// Returns the largest part of a window of `width` x `height` that leaves `stop` free; the whole window without a `stop`.
export function roomBeside(stop: Box | null, width: number, height: number): Box {
  const all: Box = { left: GAP, top: GAP, right: width - GAP, bottom: height - GAP };
  if (stop === null || stop.right <= 0 || stop.bottom <= 0 || stop.left >= width || stop.top >= height) return all;
  const area = (b: Box): number => Math.max(0, b.right - b.left) * Math.max(0, b.bottom - b.top);
  const parts: Box[] = [
    { ...all, top: stop.bottom + GAP },
    { ...all, bottom: stop.top - GAP },
    { ...all, right: stop.left - GAP },
    { ...all, left: stop.right + GAP },
  ];
  return parts.reduce((best, part) => (area(part) > area(best) ? part : best));
}

let close: (() => void) | null = null;

// Opens a dialog in place of the one that is open. It is not modal: Stop and the rest of the page work beside it, so it
// never covers Stop. A click beside it closes it, unless it `holds` what a person types.
function open(title: string, holds: boolean, ...body: Node[]): HTMLDialogElement {
  close?.();
  const before = document.activeElement;
  const dialog = el("dialog", { "aria-label": title });
  const ends = new AbortController();
  const { signal } = ends;
  const end = (): void => {
    if (signal.aborted) return;
    ends.abort();
    if (close === end) close = null;
    const inside = dialog.contains(document.activeElement);
    dialog.close();
    dialog.remove();
    if (inside && before instanceof HTMLElement && before !== document.body) before.focus();
  };
  close = end;
  dialog.addEventListener("close", end);
  const closeButton = button("Close", { text: "Close", class: "button" }, end);
  dialog.append(el("div", { class: "dialog-head" }, el("h2", {}, title), closeButton), el("div", { class: "dialog-body" }, ...body));
  // The key stops a live session too.
  window.addEventListener("keydown", (event) => {
    if (event.key === "Escape") end();
  }, { signal });
  const place = (): void => {
    const stop = document.querySelector("[data-stop]")?.getBoundingClientRect() ?? null;
    const width = document.documentElement.clientWidth;
    const height = window.innerHeight;
    const room = roomBeside(stop, width, height);
    const { style } = dialog;
    style.left = `${room.left}px`;
    style.top = `${room.top}px`;
    style.right = `${width - room.right}px`;
    style.bottom = `${height - room.bottom}px`;
    style.maxWidth = `${room.right - room.left}px`;
    style.maxHeight = `${room.bottom - room.top}px`;
  };
  document.body.append(dialog);
  place();
  dialog.show();
  const timer = window.setInterval(place, 200);
  signal.addEventListener("abort", () => window.clearInterval(timer));
  for (const event of ["resize", "scroll"] as const) window.addEventListener(event, place, { signal });
  // The click that opened the dialog is still on its way.
  window.setTimeout(() => {
    document.addEventListener("click", (event) => {
      if (!holds && event.target instanceof Node && event.target.isConnected && !dialog.contains(event.target)) end();
    }, { signal });
  });
  return dialog;
}

let help: HTMLDialogElement | null = null;

// Opens the table of keys, or closes it.
export function toggleHelp(live: boolean): void {
  if (help !== null && help.open) {
    close?.();
    return;
  }
  const rows = KEY_TABLE.map(([keys, meaning]) => {
    const cell = el("td", {});
    keys.forEach((k, i) => cell.append(...(i > 0 ? [" "] : []), el("kbd", {}, k)));
    return el("tr", {}, cell, el("td", {}, meaning));
  });
  const letters = el("input", { type: "checkbox" });
  letters.checked = lettersOn();
  letters.addEventListener("change", () => setLetters(letters.checked));
  help = open(
    "Keys",
    false,
    el("table", {}, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Key"), el("th", { scope: "col" }, "Meaning"))), el("tbody", {}, ...rows)),
    el("label", { class: "check" }, letters, el("span", {}, "Letters and signs are keys")),
    el("p", { class: "quiet" }, "Scene: drag turns, right drag moves, the wheel zooms, double click fits. Timeline and charts: click or drag to seek, Shift and drag to select a loop, the wheel zooms."),
    ...(live ? [el("p", { class: "quiet" }, "Freezing the picture does not pause the session. Stop ends it: the force goes to zero at once.")] : []),
  );
}

// Opens the present values and the facts of the session as a table, kept up to date.
export function openValues(model: Model, drawing: string): void {
  const body = el("tbody", {});
  const cells: { name: string; unit: string; cell: HTMLElement }[] = [];
  const recording = model.recording;
  for (const column of recording?.columns ?? []) {
    const how = shownAs(column.name, column.unit);
    const cell = el("td", { class: "number" });
    cells.push({ name: column.name, unit: column.unit, cell });
    body.append(el("tr", {}, el("th", { scope: "row" }, columnWord(column.name)), cell, el("td", {}, how.unit)));
  }
  const caption = el("caption", { class: "quiet" });
  const values = el("table", {}, caption, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Quantity"), el("th", { scope: "col", class: "number" }, "Value"), el("th", { scope: "col" }, "Unit"))), body);
  const facts = el("tbody", {});
  const summary = el("table", {}, facts);
  const marks = el("tbody", {});
  const update = (): void => {
    setText(caption, `At ${clock(model.shown)}`);
    for (const { name, unit, cell } of cells) {
      setText(cell, cellText(name, model.value(name), unit));
    }
    const next = sessionFacts(model);
    if (drawing !== "") next.push(["Drawing", drawing]);
    facts.replaceChildren(...next.map(([name, text]) => el("tr", {}, el("th", { scope: "row" }, name), el("td", {}, text))));
  };
  const listed = model.events.slice(-200).reverse();
  for (const e of listed) marks.append(el("tr", {}, el("td", {}, clock(e.time, 1)), el("td", {}, e.severity), el("td", {}, e.text || e.name)));
  for (const w of model.warnings.slice(-50).reverse()) marks.append(el("tr", {}, el("td", {}, w.time !== null ? clock(w.time, 1) : "–"), el("td", {}, w.severity), el("td", {}, w.text)));
  update();
  const parts: Node[] = [values, el("h3", {}, "Session"), summary];
  if (marks.childElementCount > 0) parts.push(el("h3", {}, "Events and warnings"), el("table", {}, el("thead", {}, el("tr", {}, el("th", { scope: "col" }, "Time"), el("th", { scope: "col" }, "Kind"), el("th", { scope: "col" }, "Text"))), marks));
  const dialog = open("Values", false, ...parts);
  const timer = window.setInterval(update, 500);
  dialog.addEventListener("close", () => window.clearInterval(timer));
}

const PAGE_LOST: Record<string, string> = {
  soften: "the forces soften after 2 s",
  stop: "the session stops after 2 s",
  ignore: "nothing happens",
};

// The facts of a session, in words.
export function sessionFacts(model: Model): [string, string][] {
  const r = model.recording;
  const s = model.status;
  const out: [string, string][] = [];
  const add = (name: string, text: string | undefined): void => {
    if (text !== undefined && text !== "") out.push([name, text]);
  };
  if (r !== null) {
    add("Name", r.title || r.name);
    add("Participant", r.subject);
    add("Session", [r.verb, r.mode].filter((w) => w !== "").join(", "));
    add("Device", [r.device.name, r.device.model].filter((w, i, all) => w !== "" && all.indexOf(w) === i).join(", "));
    add("Input", r.input);
    add("Rate", r.rate_hz > 0 ? `${decimals(r.rate_hz, 0)} Hz` : "");
    add("Duration", `${clock(model.end - model.start)}`);
    add("Largest force of the device", r.device.max_force !== undefined ? quantity(r.device.max_force, "N", 1) : undefined);
    add("Limit of the force", r.limits.max_force !== undefined ? quantity(r.limits.max_force, "N", 1) : undefined);
    add("Limit of the deviation", r.limits.max_deviation !== undefined ? quantity(r.limits.max_deviation, "m", 1) : undefined);
    add("Limit of the speed", r.limits.max_speed !== undefined ? quantity(r.limits.max_speed, "m/s", 0) : undefined);
    add("Clock", r.virtual_time ? "virtual: faster or slower than real time" : "");
  }
  if (s !== null) {
    add("Fresh samples", `${decimals(s.rate, 0)} Hz of ${decimals(s.asked_rate, 0)} Hz`);
    add("Late ticks", decimals(s.overruns, 0));
    add("Share of the feedback in force", `${decimals(s.share * 100, 0)} %`);
    add("Samples that did not reach this page", decimals(s.lost_rows, 0));
    if (model.hello?.control === true) add("If the controlling page is lost", PAGE_LOST[model.hello.on_page_lost] ?? model.hello.on_page_lost);
    add("Open pages", decimals(s.pages, 0));
    add("Zero force at the end", s.zero_force);
  }
  add("Software", model.hello?.software);
  return out;
}

// Returns the length of a text in UTF-8 [bytes].
export function bytesOf(text: string): number {
  return new TextEncoder().encode(text).length;
}

// Returns what is to be said of the length of a text that may have `most` bytes; "" while there is room.
export function lengthWords(text: string, most: number): string {
  const left = most - bytesOf(text.trim());
  if (left < 0) return `The text is too long by ${-left} ${left === -1 ? "byte" : "bytes"}. Shorten it: at most ${most} bytes are kept.`;
  return left <= 20 ? `${left} ${left === 1 ? "byte" : "bytes"} left` : "";
}

// Asks for the text of a mark, of at most `most` bytes. `text` and the `reason` are of an attempt before. Returns null if
// the person cancels. Playback goes on.
export function askText(title: string, label: string, most: number, text = "", reason = ""): Promise<string | null> {
  return new Promise((resolve) => {
    const field = el("input", { type: "text", class: "text-field", id: "mark-text", "aria-describedby": "mark-length" });
    field.value = text;
    let answer: string | null = null;
    const form = el("form", { method: "dialog" });
    const save = el("button", { type: "submit", class: "button" }, "Save");
    const length = el("span", { id: "mark-length", class: "text-length", role: "status" });
    const why = el("p", { class: "message problem" }, reason);
    why.hidden = reason === "";
    const show = (): void => {
      setText(length, lengthWords(field.value, most));
      save.disabled = bytesOf(field.value.trim()) > most;
    };
    field.addEventListener("input", show);
    form.append(why, el("label", { for: "mark-text" }, label), field, el("div", { class: "dialog-foot" }, length, save));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      if (save.disabled) return;
      answer = field.value.trim();
      dialog.close();
    });
    const dialog = open(title, true, form);
    dialog.addEventListener("close", () => resolve(answer));
    show();
    field.focus();
  });
}
