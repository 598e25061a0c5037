// Full screen. A real Esc in full screen goes to the browser, which leaves full screen and gives the page no key: so
// leaving it counts as Esc, unless the page itself asked for it.

let asked = false;

// Must be called by a click or a key.
export function openFullScreen(): void {
  const page = document.documentElement;
  if (typeof page.requestFullscreen === "function") void page.requestFullscreen().catch(() => undefined);
}

export function toggleFullScreen(): void {
  if (document.fullscreenElement === null) {
    openFullScreen();
    return;
  }
  asked = true;
  void document.exitFullscreen().catch(() => (asked = false));
}

// Calls `left` when the browser leaves full screen by itself. Returns a function that ends this.
export function watchFullScreen(left: () => void): () => void {
  const changed = (): void => {
    if (document.fullscreenElement !== null) {
      asked = false;
      return;
    }
    const own = asked;
    asked = false;
    if (!own) left();
  };
  document.addEventListener("fullscreenchange", changed);
  return () => document.removeEventListener("fullscreenchange", changed);
}
