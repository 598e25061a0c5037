// Labelled axes in a corner of the scene. Each end is a button that looks along its axis.
import type { Axes } from "./camera";
import type { Theme } from "./theme";

/** Size of the gizmo, and of its buttons: the least target that WCAG 2.2 asks for [CSS px]. */
const SIZE = 96;
const TARGET = 24;
const REACH = (SIZE - TARGET) / 2 - 2;

export interface Gizmo {
  readonly root: HTMLElement;
  draw(axes: Axes, theme: Theme): void;
}

export function createGizmo(look: (axis: 0 | 1 | 2, fromOtherSide: boolean) => void): Gizmo {
  const root = document.createElement("div");
  root.className = "scene-axes";
  root.setAttribute("role", "group");
  root.setAttribute("aria-label", "Views along an axis");
  const canvas = document.createElement("canvas");
  canvas.className = "scene-axes-lines";
  canvas.setAttribute("aria-hidden", "true");
  root.append(canvas);
  const ends = ([0, 1, 2] as const).flatMap((axis) =>
    [false, true].map((negative) => {
      const name = "xyz"[axis]!;
      const button = document.createElement("button");
      button.type = "button";
      button.className = negative ? "scene-axis scene-axis-negative" : "scene-axis";
      const face = document.createElement("span");
      face.className = "scene-axis-face";
      face.textContent = negative ? "" : name;
      button.append(face);
      // The view along y looks in its direction, so that x points to the right; the others look from their end.
      const side = axis === 1 ? "From the front" : axis === 2 ? "From above" : "From the right";
      const other = axis === 1 ? "From behind" : axis === 2 ? "From below" : "From the left";
      const fromOtherSide = axis === 1 ? !negative : negative;
      const label = `${fromOtherSide ? other : side}, along ${name}`;
      button.setAttribute("aria-label", label);
      button.title = label;
      button.addEventListener("click", (event) => {
        look(axis, fromOtherSide);
        // A clicked button gives the focus back, so that Space plays; a key keeps it.
        if (event.detail > 0) button.blur();
      });
      root.append(button);
      return { axis, sign: negative ? -1 : 1, button };
    }),
  );
  let key = "";
  return {
    root,
    draw(axes, theme) {
      const ratio = Math.min(2, window.devicePixelRatio || 1);
      const next = [...axes.right, ...axes.up, theme.text, ratio].join();
      if (next === key) return;
      key = next;
      if (canvas.width !== SIZE * ratio) {
        canvas.width = SIZE * ratio;
        canvas.height = SIZE * ratio;
      }
      const context = canvas.getContext("2d", { willReadFrequently: true });
      if (context === null) return;
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.clearRect(0, 0, SIZE, SIZE);
      context.strokeStyle = theme.second;
      context.lineWidth = 2;
      for (const end of ends) {
        const x = end.sign * axes.right[end.axis] * REACH;
        const y = -end.sign * axes.up[end.axis] * REACH;
        const depth = end.sign * axes.back[end.axis];
        end.button.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
        end.button.style.zIndex = String(10 + Math.round(4 * depth) + (end.sign > 0 ? 1 : 0));
        if (end.sign < 0) continue;
        context.beginPath();
        context.moveTo(SIZE / 2, SIZE / 2);
        context.lineTo(SIZE / 2 + x, SIZE / 2 + y);
        context.stroke();
      }
    },
  };
}
