/** Keyboard actions of the Design tab. */
interface Acts {
  isShown: () => boolean;
  undo: () => void;
  redo: () => void;
  save: () => void;
}

/** Bind the shortcuts Ctrl+Z: undo; Ctrl+Shift+Z and Ctrl+Y: redo; Ctrl+S: save. */
export function bindKeys({ isShown, undo, redo, save }: Acts): void {
  document.addEventListener("keydown", (e) => {
    if (!isShown() || !(e.ctrlKey || e.metaKey)) return;
    const act = { z: e.shiftKey ? redo : undo, y: redo, s: save }[e.key.toLowerCase()];
    if (!act) return;
    e.preventDefault();
    act();
  });
}
