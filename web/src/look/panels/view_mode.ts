import { byId } from "../../shared/dom";

/** End of a mode: confirmed, cancelled, or replaced by another mode or image. */
export type ModeEnd = "done" | "cancelled" | "superseded";

interface Callbacks {
  /** Called by the button; calls `begin`. */
  start: () => void;
  /** Called after the bar is hidden. */
  ended: (end: ModeEnd) => void;
}

let active: ViewMode | null = null;

/** End the active mode, because another image is opened. */
export const endMode = (): void => active?.end("superseded");

/** Mode of the view with a button and a bar with Done and Cancel; one mode is active at a time. */
export class ViewMode {
  constructor(
    private readonly button: HTMLElement,
    private readonly bar: HTMLElement,
    private readonly callbacks: Callbacks,
  ) {
    bar.tabIndex = -1;
    button.addEventListener("click", () => {
      if (this.isActive) return this.end("done");
      callbacks.start();
      bar.focus();
    });
    const [done, cancel] = bar.querySelectorAll<HTMLElement>(".actions button");
    done.addEventListener("click", () => this.end("done"));
    cancel.addEventListener("click", () => this.end("cancelled"));
    byId("stage").addEventListener("keydown", (e) => e.key === "Escape" && this.end("cancelled"));
  }

  get isActive(): boolean {
    return active === this;
  }

  /** Display the bar; another active mode ends. */
  begin(): void {
    endMode();
    this.setActive(true);
  }

  /** Hide the bar; no effect if the mode is not active. */
  end(end: ModeEnd): void {
    if (!this.isActive) return;
    const hasFocus = byId("stage").contains(document.activeElement);
    this.setActive(false);
    if (hasFocus && end !== "superseded") this.button.focus({ preventScroll: true });
    this.callbacks.ended(end);
  }

  private setActive(isActive: boolean): void {
    active = isActive ? this : null;
    this.bar.hidden = !isActive;
    this.button.setAttribute("aria-pressed", String(isActive));
  }
}
