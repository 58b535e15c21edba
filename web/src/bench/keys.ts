/** What keys do on the bench. */
interface Acts {
  isShown: () => boolean;
  undo: () => void;
  redo: () => void;
  save: () => void;
}

/** Ctrl+Z takes back, Ctrl+Shift+Z and Ctrl+Y do again, Ctrl+S saves. */
export function bindKeys({ isShown, undo, redo, save }: Acts): void {
  document.addEventListener("keydown", (e) => {
    if (!isShown() || !(e.ctrlKey || e.metaKey)) return;
    const act = { z: e.shiftKey ? redo : undo, y: redo, s: save }[e.key.toLowerCase()];
    if (!act) return;
    e.preventDefault();
    act();
  });
}
