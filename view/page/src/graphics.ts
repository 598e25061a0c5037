// Canvases for lanes and timeline, and the question whether a GPU draws them.

// Returns whether the browser draws without a GPU, and the renderer's name as far as the browser tells it.
export function findRenderer(): { software: boolean; name: string } {
  try {
    const canvas = document.createElement("canvas");
    const gl = canvas.getContext("webgl2") ?? canvas.getContext("webgl");
    if (gl === null) return { software: true, name: "" };
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    const name = String(gl.getParameter(info !== null ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return { software: /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name), name };
  } catch {
    return { software: true, name: "" };
  }
}

// A 2-D canvas that fills its host. Its size follows the host; it is cleared when that changes.
export class Surface {
  canvas: HTMLCanvasElement;
  context: CanvasRenderingContext2D;
  width = 0; // [CSS px]
  height = 0;
  private readonly host: HTMLElement;
  private readonly observer: ResizeObserver;
  private readonly resized: () => void;
  private ratio = 1;
  private software: boolean;

  constructor(host: HTMLElement, software: boolean, resized: () => void) {
    this.host = host;
    this.software = software;
    this.resized = resized;
    this.canvas = document.createElement("canvas");
    this.context = this.open();
    host.prepend(this.canvas);
    this.observer = new ResizeObserver(() => this.measure());
    this.observer.observe(host);
    this.measure();
  }

  // Without a GPU the pixels are kept in memory that the CPU draws into: ten times the frames.
  useSoftware(): void {
    if (this.software) return;
    this.software = true;
    const old = this.canvas;
    this.canvas = document.createElement("canvas");
    for (const { name, value } of old.attributes) this.canvas.setAttribute(name, value);
    this.context = this.open();
    old.replaceWith(this.canvas);
    this.width = 0;
    this.measure();
  }

  // Clears the canvas and scales it to CSS pixels.
  begin(): CanvasRenderingContext2D {
    const c = this.context;
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    return c;
  }

  dispose(): void {
    this.observer.disconnect();
    this.canvas.remove();
  }

  private open(): CanvasRenderingContext2D {
    const context = this.canvas.getContext("2d", { willReadFrequently: this.software });
    if (context === null) throw new Error("This browser has no 2-D canvas. Use a current Chromium, Firefox or Safari.");
    return context;
  }

  private measure(): void {
    const width = this.host.clientWidth;
    const height = this.host.clientHeight;
    const ratio = this.software ? 1 : Math.min(2, Math.max(1, window.devicePixelRatio || 1));
    if (width === this.width && height === this.height && ratio === this.ratio) return;
    this.width = width;
    this.height = height;
    this.ratio = ratio;
    this.canvas.width = Math.max(1, Math.round(width * ratio));
    this.canvas.height = Math.max(1, Math.round(height * ratio));
    this.resized();
  }
}

const NAMES = {
  background: "--background",
  surface: "--surface",
  text: "--text",
  second: "--text-second",
  actual: "--role-actual",
  path: "--role-path",
  expert: "--role-expert",
  force: "--role-force",
  go: "--role-go",
  warning: "--role-warning",
  stop: "--role-stop",
  line: "--line",
  grid: "--grid",
  outside: "--outside",
  run: "--run",
  border: "--border",
} as const;

export type Colours = Record<keyof typeof NAMES, string>;

// Reads the roles' colours from the styles: one place decides them.
export function readColours(): Colours {
  const style = getComputedStyle(document.documentElement);
  const out = {} as Colours;
  for (const key of Object.keys(NAMES) as (keyof typeof NAMES)[]) out[key] = style.getPropertyValue(NAMES[key]).trim();
  return out;
}

export const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", sans-serif';
export const FONT_BOLD = "600 " + FONT;
