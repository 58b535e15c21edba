import * as api from "./api";
import { NoWebGL, Renderer } from "./gl/renderer";
import type { StreamState } from "./messages";
import { Camera } from "./model/camera";
import { commandOf, fittedName, needsFile } from "./model/command";
import { panTiltOf, type Pixel } from "./model/vectors";
import { aspectOf, targetAt, viewOf, type View } from "./model/views";
import { MODES, type Mode, type State, type Store } from "./state";
import { CirclePane } from "./ui/circle";
import { banner, busy, byId, choices, copy, save, say } from "./ui/dom";
import { addressFeed, pictureFeed, streamFeed, videoFeed, type Feed } from "./ui/feed";
import { Gestures } from "./ui/gestures";
import { keep, kept } from "./ui/kept";
import { Playback } from "./ui/playback";
import { withTexts } from "./ui/png";
import { Recorder } from "./ui/recorder";
import { hasSize, RimPanel } from "./ui/rim";
import { SensorPanel } from "./ui/sensor";
import { bindSliders } from "./ui/sliders";
import { Webcams } from "./ui/webcams";

const TITLES: Record<Mode, string> = {
  panorama: "Panorama",
  perspective: "Perspective",
  dome: "Dome",
  planet: "Little planet",
  ground: "Ground plan",
  mosaic: "Mosaic",
};
const MOST_PIXELS = 2;

/** Looking through a sensor: the picture, the camera and the view, and what changes them. */
export class Look {
  feed: Feed | null = null;
  readonly renderer: Renderer;
  private readonly canvas = byId<HTMLCanvasElement>("view");
  private readonly circle: CirclePane;
  private readonly rim: RimPanel;
  private readonly playback = new Playback();
  private readonly recorder: Recorder;
  private readonly webcams = new Webcams((id) => void this.openWebcam(id));
  readonly sensor: SensorPanel;
  private camera: Camera | null = null;
  private isDirty = false;
  private isPictureNew = false;
  private hasServer = true;
  private hasProblem = false;
  private opened = 0;

  constructor(private readonly store: Store) {
    this.renderer = new Renderer(this.canvas, () => this.refresh(true));
    this.circle = new CirclePane((pixel) => this.lookAtPixel(pixel), (c) => this.rim.set(c));
    this.rim = new RimPanel(store, (isFitting) => {
      this.circle.isFitting = isFitting;
      this.refresh();
    });
    this.sensor = new SensorPanel(store, () => this.refresh(true), (e) => this.fail(e));
    const gestures = new Gestures(this.canvas, store, () => this.camera, (x, y) => this.lookAtView(x, y), () => this.playback.toggle());
    const glide = byId<HTMLInputElement>("glide");
    glide.checked = gestures.glides;
    glide.addEventListener("change", () => (gestures.glides = glide.checked));
    const show = choices<Mode>(byId("modes"), "mode", MODES.map((m) => [m, TITLES[m]] as const), (mode) => store.set({ mode }));
    show(store.state.mode);
    bindSliders(store);
    this.recorder = new Recorder(this.canvas, () => this.refresh());
    this.bindButtons();
    store.listen((s, changed) => {
      if (changed.has("mode")) show(s.mode);
      if (["sensor", "looks", "forward", "flipped"].some((key) => changed.has(key as keyof State))) void this.sensor.fetch();
      if (changed.has("sensor") && s.source === "room") void this.openRoom();
      this.refresh();
    });
    new ResizeObserver(() => this.refresh()).observe(byId("frame"));
    new ResizeObserver(() => this.refresh(true)).observe(byId("circle"));
  }

  /** Begin with what the server offers, and what the address asks for. */
  async begin(): Promise<void> {
    const start = await api.start();
    this.sensor.offer(start.sensors);
    this.offerSources(start.sources);
    const fresh = !location.hash;
    if (!this.store.state.source && start.source) this.store.set({ source: `server:${start.source}` });
    if (fresh && start.sensor) this.store.set({ sensor: start.sensor });
    else await this.sensor.fetch();
    const { source } = this.store.state;
    if (source === "room") await this.openRoom();
    else if (source.startsWith("server:")) await this.openServer(source.slice(7));
    else if (source.startsWith("webcam:")) await this.openWebcam(source.slice(7));
    else if (source === "kept") {
      const file = await kept("picture");
      if (file) await this.openFile(file.blob, file.name, false);
    }
  }

  /** Begin with a picture and a camera that the page holds itself. */
  async beginEmbedded(): Promise<void> {
    const inside = api.embedded()!;
    this.hasServer = false;
    for (const element of document.querySelectorAll<HTMLElement>("[data-server], [data-opens]")) element.hidden = true;
    byId("sources-label").hidden = true;
    this.sensor.take(new Camera(inside.camera, api.floats(inside.tables)));
    if (inside.media.startsWith("data:")) return this.openFile(api.blob(inside.media), inside.name, false);
    if (location.protocol !== "file:") return this.open(`Reading ${inside.name}`, () => addressFeed(inside.media, inside.name));
    const before = this.store.state.source === "kept" ? await kept("picture") : undefined;
    if (before?.name === inside.name) return this.openFile(before.blob, before.name, false);
    byId("invitation").textContent = `Drop ${inside.name} here`;
    byId("invitation-more").textContent = "It belongs to this page and lies beside it. From disk, browsers let a page read only what it is handed.";
  }

  fail(e: unknown): void {
    busy(null);
    if (e instanceof api.Refused || e instanceof api.Away || e instanceof NoWebGL) banner(e.message);
    else {
      banner("Something went wrong in this page; loading it anew may help.");
      throw e;
    }
  }

  /** The view of the state in so many pixels, for tests and for whoever scripts the page. */
  viewIn(width: number, height: number): { view: View; command: string } {
    const camera = this.ready()!;
    const view = viewOf(this.store.state, camera, width, height);
    return { view, command: commandOf(this.store.state, camera, this.feed!, view.width, view.height) };
  }

  // -- what is looked at -------------------------------------------------------------------------

  async openFile(blob: Blob, name: string, isNew = true): Promise<void> {
    if (/\.(toml|txt)$/i.test(name)) return this.sensor.load(blob, name);
    await this.open(`Reading ${name}`, () =>
      blob.type.startsWith("video/") || /\.(mp4|webm|mov|mkv|m4v|avi)$/i.test(name) ? videoFeed(blob, name) : pictureFeed(blob, name, this.hasServer),
    );
    if (isNew && this.feed?.name === name) {
      await keep("picture", { blob, name });
      this.store.set({ source: "kept" });
    }
  }

  async openRoom(): Promise<void> {
    const { sensor } = this.store.state;
    await this.open("Simulating the picture of a room", async () => pictureFeed(await api.room(sensor), "circle.png", true));
    if (this.feed) this.store.set({ source: "room", rim: null });
  }

  async openServer(id: string): Promise<void> {
    const option = [...byId<HTMLSelectElement>("sources").options].find((o) => o.value === id);
    const name = option?.textContent ?? id;
    const told = (state: StreamState | null): void => {
      const fine = state?.state === "playing";
      banner(fine ? null : (state?.sentence ?? "The studio's server does not answer. The stream goes on when it is back."));
    };
    await this.open(`Opening ${name}`, async () =>
      option?.dataset.kind === "picture" ? pictureFeed(await api.picture(id), name, true) : streamFeed(id, name, told),
    );
    if (this.feed?.name === name) this.store.set({ source: `server:${id}` });
  }

  private async openWebcam(id: string): Promise<void> {
    await this.open("Waiting for the camera", () => this.webcams.open(id, banner));
    if (this.feed?.device !== undefined) this.store.set({ source: `webcam:${this.feed.device}` });
  }

  private async open(words: string, make: () => Promise<Feed>): Promise<void> {
    const number = ++this.opened;
    busy(`${words}…`);
    try {
      const feed = await make();
      if (number !== this.opened) return feed.close();
      banner(null);
      this.show(feed);
    } catch (e) {
      if (number === this.opened) this.fail(e);
    } finally {
      if (number === this.opened) busy(null);
    }
  }

  private show(feed: Feed): void {
    const largest = this.renderer.largestPicture;
    if (Math.max(feed.width, feed.height) > largest)
      throw new api.Refused(`${feed.name} is ${feed.width} × ${feed.height} px; this graphics card takes ${largest} on a side.`);
    if (this.feed && (this.feed.width !== feed.width || this.feed.height !== feed.height)) this.store.set({ rim: null });
    this.feed?.close();
    this.feed = feed;
    this.playback.follow(feed.video ?? null);
    byId("empty").hidden = true;
    for (const element of document.querySelectorAll<HTMLButtonElement>("[data-needs]")) element.disabled = false;
    byId("picture-words").textContent = `${feed.name}, ${feed.width} × ${feed.height} px`;
    this.refresh(true);
  }

  // -- drawing ------------------------------------------------------------------------------------

  private refresh(isPictureNew = false): void {
    this.isPictureNew ||= isPictureNew;
    if (this.isDirty) return;
    this.isDirty = true;
    requestAnimationFrame(() => {
      this.isDirty = false;
      this.draw();
      if (this.feed?.moves) this.refresh(true);
      else if (this.recorder.isRunning) this.refresh();
    });
  }

  /** Hand the camera and the picture to the renderer; null where there is nothing that can be shown. */
  private ready(): Camera | null {
    const { feed } = this;
    if (feed && this.isPictureNew) this.circle.drawPicture(feed);
    if (!this.sensor.camera) return null;
    const camera = (this.camera = this.rim.fit(this.sensor.camera, feed));
    this.rim.show(camera);
    if (!feed) return null;
    const problem = this.problem(camera, feed);
    if (problem) banner(problem);
    else if (this.hasProblem) banner(null);
    this.hasProblem = problem !== null;
    this.canvas.hidden = byId("command").hidden = this.hasProblem;
    if (problem) return null;
    this.renderer.setCamera(camera);
    if (this.isPictureNew) this.renderer.setPicture(feed.picture, feed.width, feed.height);
    this.isPictureNew = false;
    return camera;
  }

  private draw(): void {
    const camera = this.ready();
    if (!camera || !this.feed) return;
    const view = this.sized();
    this.renderer.draw(view);
    this.circle.drawView(camera, view);
    byId("command-line").textContent = commandOf(this.store.state, camera, this.feed, view.width, view.height);
    byId("save-sensor").hidden = !needsFile(camera) || !this.hasServer;
  }

  /** Why the camera cannot show the picture so; null where it can. */
  private problem(camera: Camera, feed: Feed): string | null {
    const { model } = camera;
    if (!model.is_adjustable && !hasSize(camera, [feed.width, feed.height])) {
      const [w, h] = model.image_size;
      return `${feed.name} is ${feed.width} × ${feed.height} px, and ${model.name} belongs to pictures of ${w} × ${h}. Choose the sensor that took it.`;
    }
    return null;
  }

  /** The view as large as the page has room for. */
  private sized(): View {
    const frame = byId("frame").getBoundingClientRect();
    const dots = Math.min(devicePixelRatio, MOST_PIXELS);
    const aspect = aspectOf(this.store.state, this.camera!) ?? frame.width / frame.height;
    const width = Math.min(frame.width, frame.height * aspect);
    const pixels = (side: number): number => Math.max(2, Math.floor(side * dots));
    const view = viewOf(this.store.state, this.camera!, pixels(width), pixels(width / aspect));
    this.canvas.style.width = `${view.width / dots}px`;
    this.canvas.style.height = `${view.height / dots}px`;
    return view;
  }

  // -- what the buttons do ---------------------------------------------------------------------------

  private bindButtons(): void {
    const file = byId<HTMLInputElement>("file");
    for (const id of ["open", "choose"]) byId(id).addEventListener("click", () => file.click());
    file.addEventListener("change", () => {
      if (file.files?.[0]) void this.openFile(file.files[0], file.files[0].name);
      file.value = "";
    });
    for (const id of ["room", "try"]) byId(id).addEventListener("click", () => void this.openRoom());
    byId("sources").addEventListener("change", (e) => void this.openServer((e.target as HTMLSelectElement).value));
    byId("snapshot").addEventListener("click", () => void this.snapshot());
    byId("link").addEventListener("click", () => setTimeout(() => void copy(location.href, "Link"), 200));
    byId("copy-command").addEventListener("click", () => void copy(byId("command-line").textContent ?? "", "Command"));
    byId("save-sensor").addEventListener("click", () => void this.saveSensor());
    for (const element of document.querySelectorAll<HTMLButtonElement>("[data-needs]")) element.disabled = true;
    this.bindDropping();
  }

  private bindDropping(): void {
    const frame = byId("frame");
    document.addEventListener("dragover", (e) => {
      e.preventDefault();
      frame.classList.add("dropping");
    });
    document.addEventListener("dragleave", (e) => e.relatedTarget || frame.classList.remove("dropping"));
    document.addEventListener("drop", (e) => {
      e.preventDefault();
      frame.classList.remove("dropping");
      const file = e.dataTransfer?.files[0];
      if (file) void this.openFile(file, file.name);
    });
  }

  private offerSources(sources: readonly { id: string; name: string; kind: string }[]): void {
    const select = byId<HTMLSelectElement>("sources");
    byId("sources-label").hidden = !sources.length;
    for (const { id, name, kind } of sources) {
      const option = Object.assign(document.createElement("option"), { value: id, textContent: name });
      option.dataset.kind = kind;
      select.append(option);
    }
  }

  private async snapshot(): Promise<void> {
    this.draw(); // what is drawn is gone once the browser has shown it
    const png = await new Promise<Blob | null>((resolve) => this.canvas.toBlob(resolve, "image/png"));
    if (!png) return say("The browser made no picture.");
    const texts = { Software: "omnimirror studio", Comment: byId("command-line").textContent ?? "", Source: this.feed?.name ?? "" };
    save(await withTexts(png, texts), `${this.store.state.mode}.png`);
  }

  private async saveSensor(): Promise<void> {
    const camera = this.camera!;
    const { u, v, radius } = camera.circle;
    const wanted = {
      id: camera.model.id,
      mount: camera.model.mount,
      image_size: [...camera.size] as [number, number],
      centre_px: [u, v] as [number, number],
      rim_radius_px: radius,
    };
    try {
      save(new Blob([await api.sensorFile(wanted)], { type: "application/toml" }), fittedName(camera));
    } catch (e) {
      this.fail(e);
    }
  }

  private lookAtPixel(pixel: Pixel): void {
    const direction = this.camera?.backproject(pixel);
    if (!direction) return say("The sensor sees nothing there.");
    this.store.set(panTiltOf(direction));
    if (this.store.state.mode !== "perspective") say("Shown in the middle; Perspective looks straight there.");
  }

  /** Look at what is at a place of the view, given in parts of its width and height. */
  private lookAtView(x: number, y: number): void {
    if (!this.camera) return;
    const view = this.sized();
    const [u, v] = [x * view.width - 0.5, y * view.height - 0.5];
    const inside = (p: View["parts"][number]): boolean => u >= p.left && v >= p.top && u < p.left + p.width && v < p.top + p.height;
    const part = view.parts.find(inside);
    const target = part && targetAt(part, u - part.left, v - part.top);
    if (target) this.store.set(panTiltOf(target));
  }
}
