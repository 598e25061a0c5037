// Colours of the roles, read from the custom properties of the styles, so that one place decides them.

export interface Theme {
  readonly dark: boolean;
  readonly background: string;
  readonly text: string;
  readonly second: string;
  readonly actual: string;
  readonly path: string;
  readonly expert: string;
  readonly force: string;
  readonly go: string;
  readonly object: string;
  readonly warning: string;
  readonly stop: string;
}

/** Reads the colours that apply to an element. A missing property falls back to the light theme's colour. */
export function readTheme(element: Element): Theme {
  const style = getComputedStyle(element);
  const value = (name: string, fallback: string): string => style.getPropertyValue(name).trim() || fallback;
  const background = value("--background", "#FAFBFC");
  return {
    dark: luminance(background) < 0.2,
    background,
    text: value("--text", "#18202A"),
    second: value("--text-second", "#4B5763"),
    actual: value("--role-actual", "#004C97"),
    path: value("--role-path", "#87919D"),
    expert: value("--role-expert", "#B44FCB"),
    force: value("--role-force", "#C07A00"),
    go: value("--role-go", "#00785F"),
    object: value("--role-object", "#C9AE86"),
    warning: value("--role-warning", "#7D5A00"),
    stop: value("--role-stop", "#9E0F1A"),
  };
}

export function sameTheme(a: Theme, b: Theme): boolean {
  return (Object.keys(a) as (keyof Theme)[]).every((key) => a[key] === b[key]);
}

/** Red, green, blue (0 to 1, as written, not linear) of "#rgb", "#rrggbb" or "rgb(r, g, b)". */
export function parseColour(text: string): [number, number, number] {
  const hex = /^#([0-9a-f]{3}|[0-9a-f]{6})$/i.exec(text.trim());
  if (hex) {
    const digits = hex[1]!.length === 3 ? [...hex[1]!].map((d) => d + d).join("") : hex[1]!;
    return [0, 2, 4].map((i) => parseInt(digits.slice(i, i + 2), 16) / 255) as [number, number, number];
  }
  const numbers = text.match(/[\d.]+/g);
  if (numbers && numbers.length >= 3) return numbers.slice(0, 3).map((n) => Number(n) / 255) as [number, number, number];
  return [0.5, 0.5, 0.5];
}

/** Relative luminance of WCAG 2. */
export function luminance(colour: string): number {
  const [r, g, b] = parseColour(colour).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r! + 0.7152 * g! + 0.0722 * b!;
}

/** Ten colours of cividis (Nunez, Anderton, Renslow 2018), at equal distances. */
export const CIVIDIS = [
  "#00204D", "#00336F", "#39486B", "#575C6D", "#707173", "#8A8779", "#A69D75", "#C4B56C", "#E4CF5B", "#FFEA46",
] as const;

/** Stretch of cividis that stands out from the background of a theme: its dark or its light end does not. */
export function cividisRange(dark: boolean): readonly [number, number] {
  return dark ? [0.3, 1] : [0, 0.82];
}

/** Colour of a share 0 to 1 of the range of a theme. */
export function cividis(share: number, dark: boolean): [number, number, number] {
  const [low, high] = cividisRange(dark);
  const at = (low + Math.min(1, Math.max(0, share)) * (high - low)) * (CIVIDIS.length - 1);
  const i = Math.min(CIVIDIS.length - 2, Math.floor(at));
  const a = parseColour(CIVIDIS[i]!);
  const b = parseColour(CIVIDIS[i + 1]!);
  return [0, 1, 2].map((k) => a[k]! + (at - i) * (b[k]! - a[k]!)) as [number, number, number];
}

export function cssColour([r, g, b]: readonly [number, number, number], alpha = 1): string {
  return `rgba(${Math.round(255 * r)}, ${Math.round(255 * g)}, ${Math.round(255 * b)}, ${alpha})`;
}

/** Colour between two, `share` of the way from `a` to `b`. */
export function mix(a: string, b: string, share: number): string {
  const from = parseColour(a);
  const to = parseColour(b);
  return cssColour([0, 1, 2].map((k) => from[k]! + share * (to[k]! - from[k]!)) as [number, number, number]);
}
