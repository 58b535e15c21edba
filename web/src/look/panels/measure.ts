import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { ARROW_STEPS, byId, svg } from "../../shared/dom";
import type { MeasureRequest, MeasurementResult } from "../../shared/messages";
import { say } from "../../shared/notices";
import { clamp, fixed, words } from "../../shared/numbers";
import type { Store } from "../../shared/store";
import { cross, dot, panTiltOf, type Pixel, sum, times, type Vec3 } from "../../shared/vectors";
import type { CameraFeed, Feed } from "../feeds/feed";
import type { Camera } from "../geometry/camera";
import { pixelIn, positionOf } from "../geometry/views";
import type { Place } from "../stage";
import { ViewMode } from "./view_mode";

const CLICK = 4; // px, maximum motion of a click
const COARSE = 10; // px, step of the arrow keys with Shift
const HANDLE = 12; // px
const ARC_STEPS = 48;
const INSTRUCTION =
  "Click two points in the view, or add them with the button and move them with the arrow keys.";

/** Measurement of the angle and the distance between two points of an image. */
export class MeasurePanel {
  private readonly mode: ViewMode;
  private readonly plane = byId<HTMLSelectElement>("measure-plane");
  private readonly pan = byId<HTMLInputElement>("measure-pan");
  private readonly overlay = byId<SVGElement>("measurement");
  private readonly line = svg("path", {});
  private readonly label = svg("text", { "text-anchor": "middle" });
  private readonly handles = [0, 1].map((i) => this.handle(i));
  private pixels: Pixel[] = [];
  private cameraFeed: CameraFeed | null = null;
  private place: Place | null = null;
  private isRunning = false;
  private isOutdated = false;

  constructor(
    store: Store,
    private readonly canvas: HTMLElement,
    private readonly changed: () => void,
  ) {
    this.mode = new ViewMode(byId("measure"), byId("measure-bar"), {
      start: () => {
        this.mode.begin();
        this.update();
      },
      ended: (end) => {
        if (end !== "done") this.reset();
        changed();
      },
    });
    byId("measure-add").addEventListener("click", () => this.addInside());
    byId("measure-bar").addEventListener("change", (e) => {
      if (e.target === this.plane) this.pan.value = fixed(store.state.pan, 1).replace("−", "-");
      this.update();
    });
    let start: Pixel = [0, 0];
    canvas.addEventListener("pointerdown", (e) => (start = [e.clientX, e.clientY]));
    canvas.addEventListener("click", (e) => {
      const isClick = Math.hypot(e.clientX - start[0], e.clientY - start[1]) < CLICK;
      if (!this.mode.isActive || !isClick || e.detail > 1) return;
      if (!this.add(this.onCanvas(e)))
        say("This point is outside the field of view of the sensor.");
    });
    this.overlay.append(this.line, this.label, ...this.handles);
  }

  /** Draw the measurement in the active view; another camera changes its result. */
  show(place: Place, feeds: readonly (Feed | undefined)[]): void {
    this.place = place;
    if (this.cameraFeed && !feeds.includes(this.cameraFeed.feed)) this.reset();
    const { cameraFeed } = place;
    const isShown = this.pixels.length > 0 && this.cameraFeed?.feed === cameraFeed?.feed;
    this.overlay.toggleAttribute("hidden", !isShown);
    if (!isShown || !cameraFeed) return;
    const isSame = keyOf(this.cameraFeed!.camera) === keyOf(cameraFeed.camera);
    this.cameraFeed = cameraFeed;
    if (!isSame) this.update();
    Object.assign(this.overlay.style, {
      left: `${this.canvas.offsetLeft}px`,
      top: `${this.canvas.offsetTop}px`,
      width: `${this.canvas.offsetWidth}px`,
      height: `${this.canvas.offsetHeight}px`,
    });
    this.overlay.classList.toggle("fixed", !this.mode.isActive);
    this.handles.forEach((each, i) => this.putHandle(each, this.pixels[i]));
    this.putLine(cameraFeed.camera);
  }

  private reset(): void {
    this.pixels = [];
    this.cameraFeed = null;
    this.update();
    this.changed();
  }

  // -- points -------------------------------------------------------------------------------------

  /** Add a point at a position on the canvas, CSS px; a third point starts a new measurement. Return false outside the field. */
  private add(position: Pixel): boolean {
    const pixel = this.pixelAt(position);
    if (!pixel) return false;
    const { cameraFeed } = this.place!;
    if (this.pixels.length === 2 || this.cameraFeed?.feed !== cameraFeed!.feed) this.pixels = [];
    this.cameraFeed = cameraFeed;
    this.pixels.push(pixel);
    this.update();
    this.changed();
    return true;
  }

  /** Add a point near the centre of the active view, and focus it. */
  private addInside(): void {
    if (!this.place) return;
    const { left, top, width, height } = this.place;
    const isFirst = this.pixels.length % 2 === 0;
    const candidates = [0.5, 0.25, 0.75, 0.1, 0.9].map((fraction): Pixel => [
      left + (isFirst ? 0.4 : 0.6) * width,
      top + fraction * height,
    ]);
    if (!candidates.some((position) => this.add(position)))
      return say("The centre of the view is outside the field of view of the sensor.");
    this.show(this.place, [this.cameraFeed!.feed]); // makes the handle focusable
    this.handles[this.pixels.length - 1].focus();
  }

  /** Move a point to a position on the canvas. */
  private move(i: number, position: Pixel): void {
    const pixel = this.pixelAt(position);
    if (!pixel) return;
    this.pixels[i] = pixel;
    this.update();
    this.changed();
  }

  private handle(i: number): SVGElement {
    const element = svg("circle", {
      r: HANDLE,
      tabindex: 0,
      role: "slider",
      "aria-label": `Point ${i + 1}; arrow keys move it`,
    });
    element.addEventListener("pointerdown", (e) => element.setPointerCapture(e.pointerId));
    element.addEventListener("pointermove", (e) => {
      if (element.hasPointerCapture(e.pointerId)) this.move(i, this.onCanvas(e));
    });
    element.addEventListener("keydown", (e) => {
      const step = ARROW_STEPS[e.key];
      const position = this.positionOf(this.pixels[i]);
      if (!step || !position) return;
      e.preventDefault();
      const scale = e.shiftKey ? COARSE : 1;
      this.move(i, [position[0] + scale * step[0], position[1] + scale * step[1]]);
    });
    return element;
  }

  // -- drawing ------------------------------------------------------------------------------------

  private putHandle(element: SVGElement, pixel: Pixel | undefined): void {
    const position = pixel && this.positionOf(pixel);
    element.toggleAttribute("hidden", !position);
    const direction = pixel && this.cameraFeed!.camera.backproject(pixel);
    if (!position || !direction) return;
    const { pan, tilt } = panTiltOf(direction);
    const attributes = {
      cx: position[0],
      cy: position[1],
      tabindex: this.mode.isActive ? 0 : -1,
      "aria-valuenow": pan.toFixed(1),
      "aria-valuetext": `pan ${fixed(pan, 1)}°, tilt ${fixed(tilt, 1)}°`,
    };
    for (const [name, value] of Object.entries(attributes))
      element.setAttribute(name, String(value));
  }

  /** Draw the great circle between the two directions, in pieces if it is outside the view or the field, and its label. */
  private putLine(camera: Camera): void {
    const [first, second] = this.pixels.map((pixel) => camera.backproject(pixel));
    const arc = first && second ? greatCircle(first, second) : [];
    const points = arc.map((direction) => {
      const { pixel, visible } = camera.project(direction);
      return visible ? this.positionOf(pixel) : null;
    });
    const jump = this.canvas.offsetWidth / 2;
    const pieces = points.map((point, i) => {
      if (!point) return "";
      const last = points[i - 1];
      const isJoined = last && Math.hypot(point[0] - last[0], point[1] - last[1]) < jump;
      return `${isJoined ? "L" : "M"}${point[0]} ${point[1]}`;
    });
    this.line.setAttribute("d", pieces.join(""));
    const middle = points[points.length >> 1];
    this.label.toggleAttribute("hidden", !middle);
    if (!middle) return;
    const half = this.label.getBoundingClientRect().width / 2;
    this.label.setAttribute("x", String(clamp(middle[0], half, this.canvas.offsetWidth - half)));
    this.label.setAttribute("y", String(Math.max(20, middle[1] - 10)));
  }

  /** Return the position on the canvas of the pointer, CSS px. */
  private onCanvas(e: MouseEvent): Pixel {
    const { left, top } = this.canvas.getBoundingClientRect();
    return [e.clientX - left, e.clientY - top];
  }

  /** Return the position on the canvas of an image pixel, CSS px. */
  private positionOf(pixel: Pixel): Pixel | null {
    const { left, top, width, height, view } = this.place!;
    const at = positionOf(view, this.cameraFeed!.camera, pixel);
    return (
      at && [
        left + ((at[0] + 0.5) / view.width) * width,
        top + ((at[1] + 0.5) / view.height) * height,
      ]
    );
  }

  /** Return the image pixel at a position on the canvas, CSS px; null outside the field. */
  private pixelAt([x, y]: Pixel): Pixel | null {
    const { left, top, width, height, view, cameraFeed } = this.place!;
    const u = ((x - left) / width) * view.width - 0.5;
    const v = ((y - top) / height) * view.height - 0.5;
    return cameraFeed && pixelIn(view, cameraFeed.camera, u, v);
  }

  // -- result -------------------------------------------------------------------------------------

  /** Measure on the server; changes during a request are measured after it. */
  private update(): void {
    const { value } = this.plane;
    byId("measure-mm-field").hidden = byId("measure-sigmas").hidden = !value;
    byId("measure-pan-field").hidden = value !== "wall";
    this.isOutdated = true;
    if (!this.isRunning) background(this.run());
  }

  private async run(): Promise<void> {
    this.isRunning = true;
    while (this.isOutdated) {
      this.isOutdated = false;
      const [result, label] = await this.measured();
      if (this.isOutdated) continue;
      byId("measured").textContent = result;
      this.label.textContent = label;
      this.changed(); // the position of the label depends on its width
    }
    this.isRunning = false;
  }

  /** Return the result as a sentence and as a label; instructions or an error without one. */
  private async measured(): Promise<[string, string]> {
    if (this.pixels.length < 2) return [INSTRUCTION, ""];
    const inputs = byId("measure-bar").querySelectorAll("input");
    const invalid = [...inputs].find((input) => !input.checkValidity());
    if (invalid) return [`${invalid.labels![0].textContent}: ${invalid.validationMessage}`, ""];
    try {
      const result = await api.measure(this.request());
      const angle = quantity(result.angle_deg, result.angle_sigma_deg, "°");
      const { distance_mm, distance_sigma_mm } = result;
      const distance =
        distance_mm === null ? "" : `, distance ${quantity(distance_mm, distance_sigma_mm, " mm")}`;
      return [`Angle ${angle}${distance}${noteOf(result)}`, angle + distance];
    } catch (e) {
      if (!api.isUserError(e)) throw e;
      return [e.message, ""];
    }
  }

  private request(): MeasureRequest {
    const { model, circle, size, isMoved } = this.cameraFeed!.camera;
    const value = (id: string): number => byId<HTMLInputElement>(id).valueAsNumber;
    const distance = value("measure-mm");
    const { value: plane } = this.plane;
    return {
      id: model.id,
      mount: model.mount,
      image_size: [...size] as [number, number],
      centre_px: [circle.u, circle.v],
      rim_radius_px: circle.radius,
      is_fitted: isMoved,
      pixels: this.pixels as [[number, number], [number, number]],
      height_mm: plane === "floor" ? distance : plane === "ceiling" ? -distance : null,
      wall_mm: plane === "wall" ? distance : null,
      wall_pan_deg: value("measure-pan"),
      plane_sigma_mm: value("measure-sigma-mm"),
      plane_sigma_deg: value("measure-sigma-deg"),
      pixel_sigma_px: value("measure-sigma-px"),
    };
  }
}

/** Return directions on the great circle from one unit vector to another. */
function greatCircle(from: Vec3, to: Vec3): Vec3[] {
  const normal = cross(from, to);
  const sine = Math.hypot(...normal);
  if (!sine) return [from];
  const across = times(1 / sine, cross(normal, from));
  const angle = Math.atan2(sine, dot(from, to));
  return Array.from({ length: ARC_STEPS + 1 }, (_, i) => {
    const a = (angle * i) / ARC_STEPS;
    return sum(times(Math.cos(a), from), times(Math.sin(a), across));
  });
}

const keyOf = ({ model, circle }: Camera): string =>
  JSON.stringify([model.id, model.mount, circle]);

const noteOf = ({ angle_sigma_deg }: MeasurementResult): string =>
  angle_sigma_deg === null
    ? ". The uncertainty is known in the field of calibrated cameras only."
    : " (standard uncertainty).";

function quantity(value: number, sigma: number | null, unit: string): string {
  if (sigma === null) return words(value) + unit;
  const digits = clamp(1 - Math.floor(Math.log10(sigma || 1)), 0, 6);
  return `${fixed(value, digits)} ± ${fixed(sigma, digits)}${unit}`;
}
