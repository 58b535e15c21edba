import { ARROWS, h } from "../../shared/dom";
import type { CurveEdit } from "../../shared/messages";

/** Deform the mirror until the handle is released. */
export interface EditCallbacks {
  editCurve: (editCurve: CurveEdit) => void;
  release: (isByKey: boolean) => void;
}

/** Events of a handle. */
interface Drag {
  /** Start of a drag or of a key press. */
  begin: () => void;
  /** Displacement since the start, px to the right and down. */
  move: (right: number, down: number) => void;
  /** Release; `isByKey` after a key press. */
  end: (isByKey: boolean) => void;
}

const [STEP_PX, LARGE_STEP_PX] = [1, 10];

/** Create a draggable element of a plot; arrow keys move it, with Shift ten times as far. */
export function handle(className: string, title: string, drag: Drag): HTMLElement {
  const element = h("div", {
    className: `handle ${className}`,
    tabIndex: 0,
    role: "slider",
    title,
    "aria-label": title,
  });
  let from: readonly [number, number] | null = null;
  element.addEventListener("pointerdown", (e) => {
    if (e.button !== 0) return;
    e.preventDefault();
    element.setPointerCapture(e.pointerId);
    element.focus();
    from = [e.clientX, e.clientY];
    element.classList.add("held");
    drag.begin();
  });
  element.addEventListener(
    "pointermove",
    (e) => from && drag.move(e.clientX - from[0], e.clientY - from[1]),
  );
  const release = (): void => {
    if (!from) return;
    from = null;
    element.classList.remove("held");
    drag.end(false);
  };
  element.addEventListener("pointerup", release);
  element.addEventListener("pointercancel", release);
  element.addEventListener("keydown", (e) => {
    const way = ARROWS[e.key];
    if (!way || e.ctrlKey || e.metaKey || e.altKey) return;
    e.preventDefault();
    e.stopPropagation();
    const step = e.shiftKey ? LARGE_STEP_PX : STEP_PX;
    drag.begin();
    drag.move(step * way[0], step * way[1]);
    drag.end(true);
  });
  return element;
}

/** Set the position of a handle in its plot, px, and its value text. */
export function place(
  element: HTMLElement,
  left: number,
  top: number,
  value: number,
  words: string,
): void {
  element.style.left = `${left}px`;
  element.style.top = `${top}px`;
  element.setAttribute("aria-valuenow", String(value));
  element.setAttribute("aria-valuetext", words);
}
