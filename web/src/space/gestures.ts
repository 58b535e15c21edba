import { clamp } from "../shared/numbers";
import { moved, nearer, type Orbit, turned } from "./orbit";

const TURN = 0.008; // radians per px
const [KEY_TURN, KEY_MOVE, KEY_NEARER] = [0.09, 0.04, 1.15];
const STILL = 4; // px, maximum movement of a click

/** Actions of gestures. */
interface Callbacks {
  orbit: () => Orbit;
  look: (from: Orbit) => void;
  pick: (x: number, y: number, isTouch: boolean) => void;
  /** Select the previous or next ray. */
  step: (by: number) => void;
  fit: () => void;
}

/** Rotate, pan and zoom by mouse, touch and keys; a click selects. */
export class Gestures {
  private readonly pointers = new Map<number, PointerEvent>();
  private way = 0;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly callbacks: Callbacks,
  ) {
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.move(e));
    for (const end of ["pointerup", "pointercancel"] as const)
      canvas.addEventListener(end, (e) => this.up(e));
    canvas.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    canvas.addEventListener("keydown", (e) => this.key(e));
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  }

  private down(e: PointerEvent): void {
    if (!this.pointers.size) this.way = 0;
    this.canvas.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, e);
  }

  private move(e: PointerEvent): void {
    const before = this.pointers.get(e.pointerId);
    if (!before) return;
    const share = 1 / this.pointers.size;
    const [dx, dy] = [(e.clientX - before.clientX) * share, (e.clientY - before.clientY) * share];
    this.way += Math.hypot(dx, dy);
    const other = [...this.pointers.values()].find((p) => p.pointerId !== e.pointerId);
    if (other) {
      const apart = (p: PointerEvent): number =>
        Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
      if (apart(before) > 0)
        this.callbacks.look(nearer(this.callbacks.orbit(), apart(e) / apart(before)));
    }
    const height = this.canvas.clientHeight;
    const isMoved = other || e.shiftKey || e.buttons > 1;
    this.callbacks.look(
      isMoved
        ? moved(this.callbacks.orbit(), -dx / height, dy / height)
        : turned(this.callbacks.orbit(), -dx * TURN, dy * TURN),
    );
    this.pointers.set(e.pointerId, e);
  }

  private up(e: PointerEvent): void {
    if (
      !this.pointers.delete(e.pointerId) ||
      this.pointers.size ||
      this.way > STILL ||
      e.type !== "pointerup"
    )
      return;
    const box = this.canvas.getBoundingClientRect();
    this.callbacks.pick(e.clientX - box.left, e.clientY - box.top, e.pointerType === "touch");
  }

  /** Zoom by the wheel only if the view has the focus or Ctrl is pressed; otherwise the page scrolls. */
  private wheel(e: WheelEvent): void {
    if (document.activeElement !== this.canvas && !e.ctrlKey) return;
    e.preventDefault();
    const lines = e.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    this.callbacks.look(
      nearer(this.callbacks.orbit(), Math.exp(-clamp(e.deltaY * lines, -240, 240) * 0.0018)),
    );
  }

  private key(e: KeyboardEvent): void {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const go = (x: number, y: number) => (): void => {
      const orbit = this.callbacks.orbit();
      this.callbacks.look(
        e.shiftKey
          ? moved(orbit, x * KEY_MOVE, y * KEY_MOVE)
          : turned(orbit, x * KEY_TURN, y * KEY_TURN),
      );
    };
    const enlarge = (times: number) => (): void =>
      this.callbacks.look(nearer(this.callbacks.orbit(), times));
    const steps: Record<string, () => void> = {
      ArrowLeft: go(-1, 0),
      ArrowRight: go(1, 0),
      ArrowUp: go(0, 1),
      ArrowDown: go(0, -1),
      "+": enlarge(KEY_NEARER),
      "=": enlarge(KEY_NEARER),
      "-": enlarge(1 / KEY_NEARER),
      PageDown: () => this.callbacks.step(1),
      PageUp: () => this.callbacks.step(-1),
      Home: () => this.callbacks.fit(),
    };
    const step = steps[e.key];
    if (!step) return;
    e.preventDefault();
    step();
  }
}
