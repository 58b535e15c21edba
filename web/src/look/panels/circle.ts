import { ARROW_STEPS, byId, svg } from "../../shared/dom";
import type { Feed } from "../feeds/feed";
import type { Camera, Circle } from "../geometry/camera";
import type { Pixel } from "../../shared/vectors";
import { type Part, pixelAt, SHAPES, targetAt, type View } from "../geometry/views";
import { Magnifier } from "./magnifier";

const PER_SIDE = 48;
const HANDLE = 7; // px on the screen
const COARSE = 10; // with the Shift key

/** Raw image with the outline of the view, and handles to fit the circle. */
export class CirclePane {
  private readonly raw = byId<HTMLCanvasElement>("raw");
  private readonly overlay = byId<SVGSVGElement>("overlay");
  private readonly place = byId("circle");
  private readonly magnifier = new Magnifier(this.place);
  private camera: Camera | null = null;
  private feed: Feed | null = null;
  private activeHandle: Handle | null = null;
  private readonly handles: Record<Handle, SVGElement> = {
    centre: handle("Centre of the circle"),
    radius: handle("Edge of the circle"),
  };
  private readonly drawn = svg("g", {});
  isFitting = false;

  constructor(
    private readonly lookAt: (pixel: Pixel) => void,
    private readonly fitted: (circle: Circle) => void,
  ) {
    this.overlay.addEventListener("dblclick", (e) => this.lookAt(this.pixelOf(e)));
    this.overlay.addEventListener("pointerdown", (e) => this.grab(e));
    this.overlay.addEventListener("pointermove", (e) => this.move(e));
    for (const end of ["pointerup", "pointercancel"] as const)
      this.overlay.addEventListener(end, () => this.release());
    for (const which of ["centre", "radius"] as const)
      this.handles[which].addEventListener("keydown", (e) => this.key(e, which));
    this.overlay.append(this.drawn);
  }

  drawImage(feed: Feed): void {
    this.feed = feed;
    const box = this.place.getBoundingClientRect();
    const scale =
      Math.min(devicePixelRatio, 2) * Math.min(box.width / feed.width, box.height / feed.height);
    const [w, h] = [feed.width, feed.height].map((side) =>
      Math.max(1, Math.round(side * Math.min(scale, 1))),
    );
    if (this.raw.width !== w || this.raw.height !== h) [this.raw.width, this.raw.height] = [w, h];
    this.raw.style.objectFit = "contain";
    const context = this.raw.getContext("2d")!;
    context.imageSmoothingQuality = "high";
    context.drawImage(feed.image, 0, 0, w, h);
    const viewBox = `-0.5 -0.5 ${feed.width} ${feed.height}`;
    if (this.overlay.getAttribute("viewBox") !== viewBox)
      this.overlay.setAttribute("viewBox", viewBox);
  }

  clear(): void {
    this.feed = null;
    this.release();
    this.raw.width = 0;
    this.drawn.replaceChildren();
    for (const each of Object.values(this.handles)) each.remove();
  }

  drawView(camera: Camera, view: View): void {
    this.camera = camera;
    const outlines = view.parts.map((part) => outline(camera, part)).join("");
    const parts: SVGElement[] = [
      svg("path", { d: outlines, class: "footprint under" }),
      svg("path", { d: outlines, class: "footprint" }),
    ];
    const unit = this.unit;
    for (const part of view.parts) {
      const centre = pixelAt(camera, part, (part.width - 1) / 2, (part.height - 1) / 2);
      if (centre)
        parts.push(svg("circle", { cx: centre[0], cy: centre[1], r: 4 * unit, class: "looking" }));
    }
    if (this.isFitting) {
      const { u, v, radius } = camera.circle;
      parts.push(svg("circle", { cx: u, cy: v, r: radius, class: "rim" }));
      this.put("centre", u, v, unit, `${u.toFixed(1)}, ${v.toFixed(1)} px`, u);
      this.put(
        "radius",
        u + radius * Math.SQRT1_2,
        v + radius * Math.SQRT1_2,
        unit,
        `${radius.toFixed(1)} px`,
        radius,
      );
    }
    this.drawn.replaceChildren(...parts);
    for (const each of Object.values(this.handles)) {
      if (!this.isFitting) each.remove();
      else if (!each.isConnected) this.overlay.append(each);
    }
  }

  /** Set position and value text of a handle. */
  private put(
    which: Handle,
    u: number,
    v: number,
    unit: number,
    words: string,
    value: number,
  ): void {
    const attributes = {
      cx: u,
      cy: v,
      r: HANDLE * unit,
      "aria-valuetext": words,
      "aria-valuenow": value.toFixed(1),
    };
    for (const [name, text] of Object.entries(attributes))
      this.handles[which].setAttribute(name, String(text));
  }

  /** Move the centre or change the radius by arrow keys (right, up: larger); with Shift by 10 px. */
  private key(e: KeyboardEvent, which: Handle): void {
    const step = ARROW_STEPS[e.key];
    if (!step || !this.camera) return;
    e.preventDefault();
    const [du, dv] = step.map((s) => s * (e.shiftKey ? COARSE : 1));
    const { u, v, radius } = this.camera.circle;
    const circle =
      which === "centre"
        ? { u: u + du, v: v + dv, radius }
        : { u, v, radius: Math.max(4, radius + du - dv) };
    this.camera = this.camera.fitted(circle, this.camera.size); // further key presses can precede the next frame
    this.fitted(circle);
  }

  /** Image pixels per screen pixel. */
  private get unit(): number {
    return 1 / (this.overlay.getScreenCTM()?.a || 1);
  }

  private pixelOf(e: MouseEvent): Pixel {
    const p = new DOMPoint(e.clientX, e.clientY).matrixTransform(
      this.overlay.getScreenCTM()!.inverse(),
    );
    return [p.x, p.y];
  }

  private grab(e: PointerEvent): void {
    if (!this.isFitting || !this.camera) return;
    const [u, v] = this.pixelOf(e);
    const { u: cu, v: cv, radius } = this.camera.circle;
    const near = 24 * this.unit;
    const onAvailability = Math.hypot(u - cu, v - cv);
    if (Math.abs(onAvailability - radius) < near) this.activeHandle = "radius";
    else if (onAvailability < near) this.activeHandle = "centre";
    if (!this.activeHandle) return;
    this.overlay.setPointerCapture(e.pointerId);
    this.enlarge([u, v], this.camera.circle);
  }

  private move(e: PointerEvent): void {
    if (!this.activeHandle || !this.camera) return;
    const [u, v] = this.pixelOf(e);
    const { u: cu, v: cv, radius } = this.camera.circle;
    const circle =
      this.activeHandle === "centre"
        ? { u, v, radius }
        : { u: cu, v: cv, radius: Math.max(4, Math.hypot(u - cu, v - cv)) };
    this.fitted(circle);
    this.enlarge([u, v], circle);
  }

  private enlarge(at: Pixel, circle: Circle): void {
    if (this.feed) this.magnifier.show(this.feed, at, circle, this.unit);
  }

  private release(): void {
    this.activeHandle = null;
    this.magnifier.hide();
  }
}

type Handle = "centre" | "radius";

function handle(name: string): SVGElement {
  return svg("circle", {
    class: "handle",
    tabindex: 0,
    role: "slider",
    "aria-label": `${name}; arrow keys move it`,
  });
}

/** Return the outline of a part of the view in the image, which follows the field boundary outside the field. */
function outline(camera: Camera, part: Part): string {
  const [w, h] = [part.width, part.height];
  const points: Pixel[] = [];
  const add = (u: number, v: number): void => {
    const target = targetAt(part, u, v);
    if (target) points.push(camera.project(target, part.isPoint).pixel);
  };
  const round = part.shape === SHAPES.polar;
  for (let side = 0; side < 4 && !round; side++)
    for (let i = 0; i < PER_SIDE; i++) {
      const t = i / PER_SIDE;
      const [u, v] = [
        [t, 0],
        [1, t],
        [1 - t, 1],
        [0, 1 - t],
      ][side];
      add(u * w - 0.5, v * h - 0.5);
    }
  for (let i = 0; i < 2 * PER_SIDE && round; i++) {
    const [phi, radius] = [(i * Math.PI) / PER_SIDE, Math.min(w, h) / 2 - 0.5];
    add((w - 1) / 2 + radius * Math.cos(phi), (h - 1) / 2 + radius * Math.sin(phi));
  }
  return points.length
    ? `M${points.map(([u, v]) => `${u.toFixed(1)} ${v.toFixed(1)}`).join("L")}Z`
    : "";
}
