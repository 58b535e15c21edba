import { colour, h } from "../shared/dom";
import { words } from "../shared/numbers";
import { type Body, Drawing, type Ink, type Line } from "./drawing";
import { Gestures } from "./gestures";
import type { EvaluationBlocks, Host } from "./host";
import { axesOf, fitting, matrixOf, nearOf, type Orbit } from "./orbit";
import { nearest, type Ray, raysOf } from "./rays";
import { boundsOf, edgesOf, frameOf, revolved } from "./shapes";
import type { Vec3 } from "../shared/vectors";
import { add } from "./vectors";

/** Material of a part: colour, opacity, shine. */
const CAMERA_ORIENTATIONS: Record<string, readonly [ink: string, alpha: number, shine: number]> = {
  mirror: ["mirror", 1, 1],
  "second mirror": ["mirror", 1, 1],
  body: ["soft", 1, 0],
  barrel: ["soft", 0.6, 0],
  lens: ["accent", 0.35, 0],
  tube: ["accent", 0.04, 0],
  dome: ["accent", 0.04, 0],
  window: ["accent", 0.04, 0],
};
const MECHANICAL = ["soft", 0.4, 0] as const; // mechanical parts: camera, rod, lids, rims
const [REACH, TOUCH_REACH] = [9, 18]; // px, selection radius
const [GROWN, SERVER_UNAVAILABLE] = [1.7, 0.3]; // change of size or position, as a ratio, above which the viewpoint is reset
const FIRST: Orbit = { target: [0, 0, 0], distance: 400, around: -1.15, above: -0.14 };
const [SIDE, ABOVE] = [
  { around: -Math.PI / 2, above: 0 },
  { around: -Math.PI / 2, above: Math.PI / 2 },
];
const ROOM_ABOVE = 0.32; // minimum elevation for a view of the room, radians
const ROOM_SHARE = 0.62; // distance relative to that of the complete room; near walls can be cut off
const KEYS =
  "Arrow keys rotate, with Shift pan; plus and minus zoom; Page Up and Page Down select rays.";

/** 3-D view of a sensor: parts, rays and room; redrawn after changes. */
export class SpaceView {
  orbit = FIRST;
  rays: Ray[] = [];
  picked: Ray | null = null;
  /** Number of drawn frames, for benchmarks. */
  frames = 0;
  readonly canvas: HTMLCanvasElement;
  private readonly drawing: Drawing;
  private readonly readout = h("output", { className: "readout" });
  private readonly around = h("input", { type: "checkbox", name: "All azimuths" });
  private result: EvaluationBlocks | null = null;
  private bounds: [Vec3, Vec3] = [
    [0, 0, 0],
    [0, 0, 0],
  ];
  private isDue = false;

  constructor(
    private readonly host: Host,
    gl: WebGL2RenderingContext,
  ) {
    this.canvas = gl.canvas as HTMLCanvasElement;
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `3-D view of the sensor. ${KEYS}`);
    this.drawing = new Drawing(gl);
    const look = {
      orbit: () => this.orbit,
      look: (from: Orbit) => this.look(from),
      fit: () => this.fit(),
    };
    new Gestures(this.canvas, {
      ...look,
      pick: (x, y, isTouch) => this.pick(x, y, isTouch),
      step: (by) => this.step(by),
    });
    this.around.addEventListener("change", () => this.show(this.result!));
    const button = (text: string, title: string, act: () => void): HTMLElement =>
      h("button", { type: "button", className: "small", title, onclick: act }, text);
    const buttons = [
      button("Sensor", "Complete sensor (Home)", () => this.fit()),
      button("From the side", "Horizontal view", () => this.fit(SIDE)),
      button("From above", "Vertical view", () => this.fit(ABOVE)),
      button("Room", "Complete room", () => this.fitRoom()),
      h("label", { className: "check" }, this.around, " All azimuths"),
      button("‹ Ray", "Previous ray (Page Up)", () => this.step(-1)),
      button("Ray ›", "Next ray (Page Down)", () => this.step(1)),
    ];
    host.place.replaceChildren(
      this.canvas,
      this.readout,
      h("div", { className: "row", role: "group", "aria-label": "Viewpoint" }, ...buttons),
    );
    new ResizeObserver(() => this.due()).observe(this.canvas);
  }

  /** Set the evaluation of a design. */
  show(result: EvaluationBlocks): void {
    const room = result.block("room");
    const table = result.block("rays");
    if (!room || !table) return;
    this.result = result;
    const bodies = bodiesOf(result);
    this.drawing.setBodies(bodies);
    this.measure(boundsOf(bodies.map((b) => b.mesh)));
    this.rays = raysOf(table).filter((ray) => this.around.checked || ray.isForward);
    if (this.picked)
      this.picked = this.rays.find((ray) => ray.index === this.picked!.index) ?? null;
    this.drawLines();
  }

  /** Set the accessible description. */
  describe(): void {
    if (!this.result) return;
    const names = partsOf(this.result).map(({ name }) => name);
    const [low, high] = this.bounds;
    const angles = this.rays.map((ray) => ray.omega);
    this.canvas.setAttribute(
      "aria-label",
      `3-D view of the sensor: ${names.join(", ")}, ${add(high, low, -1)
        .map((mm) => words(mm, 3))
        .join(
          " by ",
        )} mm, ${this.rays.length} rays with field angles from ${words(Math.min(...angles), 3)}° to ${words(Math.max(...angles), 4)}°. ${KEYS}`,
    );
  }

  look(from: Orbit): void {
    this.orbit = from;
    this.due();
  }

  /** Show the complete sensor. */
  fit(from: Partial<Orbit> = {}): void {
    this.look(fitting({ ...this.orbit, ...from }, ...this.bounds, this.aspect()));
  }

  private fitRoom(): void {
    const room = this.result?.block("room");
    if (!room) return;
    const corner = (end: string): Vec3 => [
      room.column(`x${end}`)[0],
      room.column(`y${end}`)[0],
      room.column(`z${end}`)[0],
    ];
    const orbit = { ...this.orbit, above: Math.max(ROOM_ABOVE, this.orbit.above) };
    const whole = fitting(orbit, corner("0"), corner("1"), this.aspect());
    this.look({ ...whole, distance: ROOM_SHARE * whole.distance });
  }

  /** Reset the viewpoint if the size changed considerably. */
  private measure(bounds: [Vec3, Vec3]): void {
    const size = ([low, high]: [Vec3, Vec3]): number => Math.hypot(...add(high, low, -1));
    const grown = size(bounds) / size(this.bounds);
    const onAvailability = Math.hypot(...add(add(...bounds), add(...this.bounds), -1)) / 2;
    const isAsBefore =
      grown < GROWN && grown > 1 / GROWN && onAvailability < SERVER_UNAVAILABLE * size(bounds);
    this.bounds = bounds;
    if (!isAsBefore) this.fit();
  }

  private pick(x: number, y: number, isTouch: boolean): void {
    const { clientWidth, clientHeight } = this.canvas;
    this.read(
      nearest(
        this.rays,
        matrixOf(this.orbit, this.aspect()),
        [clientWidth, clientHeight],
        [x, y],
        isTouch ? TOUCH_REACH : REACH,
      ),
    );
  }

  private step(by: number): void {
    const now = this.picked ? this.rays.indexOf(this.picked) + by : by > 0 ? 0 : -1;
    this.read(this.rays.at(now % this.rays.length) ?? null);
  }

  private read(ray: Ray | null): void {
    this.picked = ray;
    this.drawLines();
    this.host.read(ray?.omega ?? null);
  }

  private drawLines(): void {
    this.readout.textContent =
      this.picked?.words ?? "Click a ray to display its values; drag to rotate, with Shift to pan.";
    const [hidden, ray, ink, soft] = ["bad", "accent", "ink", "soft"].map((name) => inkOf(name));
    const of = (each: Ray): Line[] => {
      const isPicked = each === this.picked;
      const look = {
        ink: isPicked ? ink : faded(each.isHidden ? hidden : ray, 0.75),
        width: isPicked ? 2.6 : 1.3,
      };
      return each.nodes.slice(1).map((to, i) => ({ from: each.nodes[i], to, ...look }));
    };
    const boxes = edgesOf(this.result!.block("room")!).flatMap((edges, i) =>
      edges.map(([from, to]): Line => ({ from, to, ink: faded(soft, i ? 0.4 : 0.8), width: 1 })),
    );
    const met = this.picked?.nodes[this.picked.mirror];
    this.drawing.setLines([
      ...boxes,
      ...this.rays.flatMap(of),
      ...(this.picked ? of(this.picked) : []),
      ...(met ? [{ from: met, to: met, ink, width: 8 }] : []),
    ]);
    this.due();
  }

  private aspect(): number {
    return this.canvas.clientWidth / Math.max(1, this.canvas.clientHeight);
  }

  /** Draw once at the next animation frame. */
  private due(): void {
    if (this.isDue) return;
    this.isDue = true;
    requestAnimationFrame(() => {
      this.isDue = false;
      this.draw();
    });
  }

  draw(): void {
    const { canvas, orbit } = this;
    const dots = devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((px) =>
      Math.max(1, Math.round(px * dots)),
    );
    if (canvas.width !== width || canvas.height !== height)
      [canvas.width, canvas.height] = [width, height];
    this.drawing.draw({
      matrix: matrixOf(orbit, this.aspect()),
      eye: axesOf(orbit).eye,
      near: nearOf(orbit),
      ground: inkOf("panel"),
      dots,
    });
    this.frames++;
  }
}

/** Return the parts of a response: names and profiles. */
const partsOf = (result: EvaluationBlocks): { name: string; block: string }[] =>
  result.blocks
    .filter((b) => b.name.startsWith("part "))
    .map(({ name }) => ({ name: name.slice(5), block: name }));

const bodiesOf = (result: EvaluationBlocks): Body[] =>
  partsOf(result).map(({ name, block }) => {
    const [ink, alpha, shine] = CAMERA_ORIENTATIONS[name] ?? MECHANICAL;
    return {
      mesh: revolved(result.block(block)!, frameOf(result.block(`frame ${name}`)!)),
      ink: faded(inkOf(ink), alpha),
      shine,
    };
  });

const faded = ([r, g, b]: Ink, alpha: number): Ink => [r, g, b, alpha];

/** Parse a colour, #rrggbb or #rgb. */
function inkOf(name: string): Ink {
  const digits = colour(name).slice(1);
  const value = Number.parseInt(digits.length === 3 ? digits.replace(/./g, "$&$&") : digits, 16);
  return [((value >> 16) & 255) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255, 1];
}
