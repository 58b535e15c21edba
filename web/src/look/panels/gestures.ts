import { clamp } from "../../shared/numbers";
import { MODES, type State } from "../../shared/state";
import type { Store } from "../../shared/store";
import type { Camera } from "../geometry/camera";
import { RAD } from "../../shared/vectors";
import { elevations, isAllHigh, spanOf } from "../geometry/views";
import { asShown } from "../stage";

const KEY_STEP = 0.06; // of the width of the view
const ZOOM_STEP = 1.15;
const FRICTION_S = 0.25;

/** Dragging while the horizon is levelled. */
interface Horizon {
  isDragged: () => boolean;
  drag: (from: PointerEvent, to: PointerEvent) => void;
  settle: () => void;
}

/** Screen rectangle of the active view; `choose` activates the view under the pointer. */
interface Shown {
  box: () => DOMRect;
  choose: (e: PointerEvent) => void;
}

/** Drag, wheel, pinch and key controls of the view. */
export class Gestures {
  glides = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  private readonly pointers = new Map<number, PointerEvent>();
  private speed = { x: 0, y: 0, at: 0 };
  private gliding = 0;

  constructor(
    private readonly view: HTMLElement,
    private readonly store: Store,
    private readonly camera: () => Camera | null,
    private readonly lookAt: (u: number, v: number) => void,
    private readonly stop: () => void,
    private readonly horizon: Horizon,
    private readonly shown: Shown,
  ) {
    view.addEventListener("pointerdown", (e) => this.down(e));
    view.addEventListener("pointermove", (e) => this.move(e));
    for (const end of ["pointerup", "pointercancel"] as const)
      view.addEventListener(end, (e) => this.up(e));
    view.addEventListener("wheel", (e) => this.wheel(e), { passive: false });
    view.addEventListener("dblclick", (e) => {
      const box = this.shown.box();
      this.lookAt((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height);
    });
    view.addEventListener("keydown", (e) => this.key(e));
  }

  private down(e: PointerEvent): void {
    cancelAnimationFrame(this.gliding);
    if (!this.pointers.size) this.shown.choose(e);
    this.view.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, e);
    this.view.classList.add("held");
    this.speed = { x: 0, y: 0, at: e.timeStamp };
  }

  private move(e: PointerEvent): void {
    const before = this.pointers.get(e.pointerId);
    if (!before) return;
    if (this.pointers.size === 2) {
      const other = [...this.pointers.values()].find((p) => p.pointerId !== e.pointerId)!;
      const apart = (p: PointerEvent): number =>
        Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY);
      if (apart(before) > 0) this.enlarge(apart(e) / apart(before));
    }
    const share = 1 / this.pointers.size;
    const [dx, dy] = [(e.clientX - before.clientX) * share, (e.clientY - before.clientY) * share];
    if (this.horizon.isDragged()) this.horizon.drag(before, e);
    else this.drag(dx, dy, before);
    const seconds = Math.max((e.timeStamp - this.speed.at) / 1000, 0.001);
    this.speed = { x: dx / seconds, y: dy / seconds, at: e.timeStamp };
    this.pointers.set(e.pointerId, e);
  }

  private up(e: PointerEvent): void {
    if (!this.pointers.delete(e.pointerId) || this.pointers.size) return;
    this.view.classList.remove("held");
    if (this.horizon.isDragged()) return this.horizon.settle();
    if (
      this.glides &&
      e.timeStamp - this.speed.at < 60 &&
      Math.hypot(this.speed.x, this.speed.y) > 80
    )
      this.glide(e);
  }

  private glide(from: PointerEvent): void {
    let { x, y } = this.speed;
    let last = performance.now();
    const step = (now: number): void => {
      const passed = (now - last) / 1000;
      const seconds = Math.min(passed, 0.05); // limits the step after a slow frame
      last = now;
      const rest = Math.exp(-passed / FRICTION_S);
      [x, y] = [x * rest, y * rest];
      this.drag(x * seconds, y * seconds, from);
      if (Math.hypot(x, y) > 10) this.gliding = requestAnimationFrame(step);
    };
    this.gliding = requestAnimationFrame(step);
  }

  /** Drag the view with the point under the pointer; circular views and plans rotate about their centre. */
  private drag(dx: number, dy: number, at: PointerEvent): void {
    const { state: s } = this.store;
    const camera = this.camera();
    if (!camera) return;
    const box = this.shown.box();
    if (s.mode === "dome" || s.mode === "planet" || s.mode === "ground") {
      const [x, y] = [at.clientX - box.left - box.width / 2, at.clientY - box.top - box.height / 2];
      const turn = (x * dy - y * dx) / Math.max(x * x + y * y, 400);
      const side = s.mode !== "ground" && camera.model.pole === "zenith" ? -1 : 1;
      this.store.set({ pan: s.pan - (side * turn) / RAD });
      return;
    }
    this.turn(-dx / box.width, dy / box.width);
  }

  /** Pan and tilt by fractions of the width of the view. */
  private turn(right: number, up: number): void {
    const s = asShown(this.store.state);
    const camera = this.camera();
    if (!camera) return;
    const { width, height } = this.shown.box();
    if (s.mode === "perspective") {
      const perWidth = (2 * Math.tan((s.hfov * RAD) / 2)) / RAD;
      const tilt = s.tilt + up * perWidth;
      this.store.set({
        pan: s.pan + (right * perWidth) / Math.max(0.2, Math.cos(s.tilt * RAD)),
        tilt,
      });
    } else if (s.mode === "panorama") {
      const [low, high] = elevations(s, camera, width / height);
      const [middle, span] = [(low + high) / 2, spanOf(s, camera, width / height)];
      this.store.set({
        pan: s.pan + right * span,
        tilt: isAllHigh(s, camera, width / height) ? s.tilt : middle + up * span,
      });
    } else
      this.store.set({
        pan: s.pan + right * 360,
        tilt: s.tilt + (s.mode === "mosaic" ? up * 360 : 0),
      });
  }

  private enlarge(factor: number): void {
    const { state: s } = this.store;
    if (s.mode === "perspective" || s.mode === "mosaic") {
      const hfov = (2 * Math.atan(Math.tan((s.hfov * RAD) / 2) / factor)) / RAD;
      this.store.set({ hfov: clamp(hfov, 5, 150) });
    } else this.store.set({ zoom: s.zoom * factor });
  }

  private wheel(e: WheelEvent): void {
    e.preventDefault();
    const lines = e.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    this.enlarge(Math.exp(-clamp(e.deltaY * lines, -240, 240) * 0.0018));
  }

  private key(e: KeyboardEvent): void {
    if (e.ctrlKey || e.metaKey || e.altKey) return;
    const steps: Record<string, () => void> = {
      ArrowLeft: () => this.turn(-KEY_STEP, 0),
      ArrowRight: () => this.turn(KEY_STEP, 0),
      ArrowUp: () => this.turn(0, KEY_STEP),
      ArrowDown: () => this.turn(0, -KEY_STEP),
      "+": () => this.enlarge(ZOOM_STEP),
      "=": () => this.enlarge(ZOOM_STEP),
      "-": () => this.enlarge(1 / ZOOM_STEP),
      " ": () => this.stop(),
      "0": () => this.store.set(WHOLE),
      Home: () => this.store.set(WHOLE),
    };
    MODES.forEach((mode, i) => (steps[String(i + 1)] = () => this.store.set({ mode })));
    const step = steps[e.key];
    if (!step) return;
    e.preventDefault();
    step();
  }
}

const WHOLE: Partial<State> = { pan: 0, tilt: 0, zoom: 1, hfov: 90 };
