import * as api from "../shared/api";
import { byId, choices, save } from "../shared/dom";
import type { Source, StreamState } from "../shared/messages";
import { banner, busy, copy, say } from "../shared/notices";
import { type Mode, MODES, type State } from "../shared/state";
import type { Store } from "../shared/store";
import { NO_ANSWER, WENT_WRONG } from "../shared/texts";
import { commandOf, fittedName, needsFile } from "./command";
import { NoWebGL, Renderer } from "./drawing/renderer";
import { blob, embedded, floats } from "./embedded";
import { addressFeed, type Feed, pictureFeed, streamFeed, videoFeed } from "./feeds/feed";
import { identityIn, identityOf, keepPicture, keptPicture, sourceOf } from "./feeds/kept";
import { Playback } from "./feeds/playback";
import { withTexts } from "./feeds/png";
import { Recorder } from "./feeds/recorder";
import { Webcams } from "./feeds/webcams";
import { Camera } from "./geometry/camera";
import { panTiltOf, type Pixel, type Vec3 } from "./geometry/vectors";
import { aspectOf, targetAt, type View, viewOf } from "./geometry/views";
import { CirclePane } from "./panels/circle";
import { Gestures } from "./panels/gestures";
import { LevelPanel } from "./panels/level";
import { hasSize, RimPanel } from "./panels/rim";
import { SensorPanel } from "./panels/sensor";
import { bindSliders } from "./panels/sliders";

const TITLES: Record<Mode, string> = {
  panorama: "Panorama",
  perspective: "Perspective",
  dome: "Dome",
  planet: "Little planet",
  ground: "Ground plan",
  mosaic: "Mosaic",
};
const MOST_PIXELS = 2;
const REST_MS = 120; // after which a view that moved is drawn with care
const INVITATION = "Drop a picture or video here";
const INVITATION_MORE = "One taken with a curved mirror, a mirror ball or a fisheye. It stays on this machine.";

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
  private readonly level: LevelPanel;
  private camera: Camera | null = null;
  private isDirty = false;
  private isPictureNew = false;
  private hasServer = true;
  private hasBegun = false;
  private opened = 0;
  /** The source that is shown, as the state names it; of a room also the sensor that took it. */
  private shown = "";
  private movedAt = 0;
  private resting = 0;

  constructor(private readonly store: Store) {
    this.renderer = new Renderer(this.canvas, () => this.refresh(true));
    this.circle = new CirclePane((pixel) => this.lookAtPixel(pixel), (c) => this.rim.set(c));
    this.rim = new RimPanel(store, (isFitting) => {
      this.circle.isFitting = isFitting;
      document.body.classList.toggle("fitting", isFitting);
      (isFitting ? byId("frame") : byId("raw-place")).append(byId("circle")); // large enough to aim at
      if (isFitting) byId("frame").scrollIntoView({ block: "nearest" });
      this.refresh(true);
    });
    this.sensor = new SensorPanel(store, {
      changed: () => this.refresh(true),
      failed: (e) => this.fail(e, "sensor"),
      prepare: (wanted) => this.prepare(wanted),
    });
    this.level = new LevelPanel(store, () => this.sensor, () => this.refresh());
    const horizon = {
      isDragged: () => this.level.isDragged(),
      drag: (from: PointerEvent, to: PointerEvent) => this.dragHorizon(from, to),
      settle: () => this.sensor.settleLean(),
    };
    const gestures = new Gestures(this.canvas, store, () => this.camera, (x, y) => this.lookAtView(x, y), () => this.playback.toggle(), horizon);
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
      if (changed.has("source") && this.hasBegun) void this.openAsked();
      this.movedAt = performance.now();
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
    if (!this.store.state.source && start.source) this.store.set({ source: `server:${start.source}` }, false);
    if (fresh && start.sensor) this.store.set({ sensor: start.sensor }, false);
    await this.sensor.want();
    this.hasBegun = true;
    await this.openAsked();
  }

  /** Begin with a picture and a camera that the page holds itself. */
  async beginEmbedded(): Promise<void> {
    const inside = embedded()!;
    this.hasServer = false;
    for (const element of document.querySelectorAll<HTMLElement>("[data-server], [data-opens]")) element.hidden = true;
    byId("sources-label").hidden = true;
    this.sensor.take(new Camera(inside.camera, floats(inside.tables)));
    if (inside.media.startsWith("data:")) return this.openFile(blob(inside.media), inside.name, false);
    if (location.protocol !== "file:") return this.open(`Reading ${inside.name}`, () => addressFeed(inside.media, inside.name), "", true);
    const before = identityIn(this.store.state.source);
    const file = before?.name === inside.name ? await keptPicture(before) : undefined;
    if (file) return this.openFile(file.blob, file.name, false);
    this.invite(`Drop ${inside.name} here`, "It belongs to this page and lies beside it. From disk, browsers let a page read only what it is handed.");
  }

  fail(e: unknown, about: "picture" | "sensor" = "picture"): void {
    busy(null);
    if (e instanceof api.Away) banner(e.message, "server");
    else if (e instanceof api.Refused || e instanceof NoWebGL) banner(e.message, about);
    else {
      banner(WENT_WRONG);
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

  /** Open a file that was handed to the page, or one that it kept. */
  async openFile(blob: Blob, name: string, isNew = true): Promise<void> {
    if (/\.(toml|txt)$/i.test(name)) return this.sensor.load(blob, name);
    const make = (): Promise<Feed> => this.feedOf(blob, name);
    if (!isNew) return this.open(`Reading ${name}`, make, "", true);
    const identity = await identityOf(blob, name);
    const isWanted = identityIn(this.store.state.source)?.id === identity.id; // as of a link that came without it
    await this.open(`Reading ${name}`, make, sourceOf(identity), isWanted);
    if (this.shown === sourceOf(identity)) await keepPicture(identity, { blob, name });
  }

  private feedOf(blob: Blob, name: string): Promise<Feed> {
    const isVideo = blob.type.startsWith("video/") || /\.(mp4|webm|mov|mkv|m4v|avi)$/i.test(name);
    return isVideo ? videoFeed(blob, name) : pictureFeed(blob, name, this.hasServer);
  }

  async openRoom(turns = true): Promise<void> {
    await this.open("Simulating the picture of a room", () => this.roomOf(this.store.state.sensor), "room", false, turns);
  }

  private async roomOf(sensor: string): Promise<Feed> {
    const made = await api.room(sensor);
    return { ...(await pictureFeed(made, "circle.png", true)), made };
  }

  private async openServer(id: string, isAsked = false): Promise<void> {
    const option = [...byId<HTMLSelectElement>("sources").options].find((o) => o.value === id);
    if (!option) return this.fail(new api.Refused(`The address asks for ${id}, which this server does not offer. Open a picture, or choose what it offers.`));
    const name = option.textContent ?? id;
    const told = (state: StreamState | null): void => {
      const fine = state?.state === "playing";
      banner(fine ? null : (state?.sentence ?? `${NO_ANSWER} ${name} goes on when it is back.`), "picture");
    };
    const make = async (): Promise<Feed> => {
      const feed = option.dataset.kind === "picture" ? await pictureFeed(await api.picture(id), name, true) : await streamFeed(id, name, told);
      return Object.assign(feed, { source: option.dataset.command });
    };
    await this.open(`Opening ${name}`, make, `server:${id}`, isAsked);
  }

  private async openWebcam(id: string, isAsked = false): Promise<void> {
    const lost = (sentence: string): void => banner(sentence, "picture");
    await this.open("Waiting for the camera", () => this.webcams.open(id, lost), (feed) => `webcam:${feed.device}`, isAsked);
  }

  /** Open what the address asks for, and nothing in its place. */
  private async openAsked(): Promise<void> {
    const { source, sensor } = this.store.state;
    this.opened++; // what is still on its way was asked for before
    busy(null);
    if (this.shown === nameOf(source, sensor)) return;
    if (this.feed) this.close();
    const [kind, rest] = [source.split(":", 1)[0], source.slice(source.indexOf(":") + 1)];
    if (kind === "room") return this.open("Simulating the picture of a room", () => this.roomOf(sensor), "room", true);
    if (kind === "server") return this.openServer(rest, true);
    if (kind === "webcam") return this.openWebcam(rest, true);
    const identity = identityIn(source);
    if (!identity) return source ? this.fail(new api.Refused(`source = ${source} of the address is not understood; open a picture instead.`)) : undefined;
    const file = identity.id ? await keptPicture(identity) : undefined;
    if (file && source === this.store.state.source) return this.open(`Reading ${file.name}`, () => this.feedOf(file.blob, file.name), source, true);
    const name = identity.name || "its picture";
    this.invite(`Drop ${name} here`, `This link is a view of ${identity.name || "a picture that it does not name"}, which this browser does not hold: links hold the view, not the picture.`);
  }

  /** Of another sensor, the demo room has another picture. */
  private async prepare({ source, sensor }: State): Promise<(() => void) | null> {
    if (source !== "room" || !this.shown || this.shown === nameOf(source, sensor)) return null;
    const number = ++this.opened;
    const feed = await this.roomOf(sensor);
    return () => {
      if (number !== this.opened) return feed.close();
      this.shown = nameOf(source, sensor);
      this.show(feed);
    };
  }

  /** Open a source, and make the state name it; `isAsked` is for one that the state names already, with all that is seen of it. */
  private async open(words: string, make: () => Promise<Feed>, source: string | ((feed: Feed) => string) = "", isAsked = false, turns = !isAsked): Promise<void> {
    const number = ++this.opened;
    busy(`${words}…`);
    try {
      const feed = await make();
      if (number !== this.opened) return feed.close();
      const isAlike = isAsked || (source !== "room" && this.feed?.width === feed.width && this.feed.height === feed.height);
      const named = typeof source === "string" ? source : source(feed);
      this.show(feed);
      banner(null, "picture");
      this.shown = nameOf(named, this.store.state.sensor);
      this.store.set({ ...(source && { source: named }), ...(!isAlike && { rim: null }) }, turns);
    } catch (e) {
      if (number === this.opened) this.fail(e);
    } finally {
      if (number === this.opened) busy(null);
    }
  }

  /** Show nothing, as at first. */
  private close(): void {
    this.feed?.close();
    this.feed = null;
    this.shown = "";
    this.playback.follow(null);
    this.circle.clear();
    banner(null, "picture");
    this.showWhether(false);
    byId("picture-words").textContent = "None yet.";
    this.invite(INVITATION, INVITATION_MORE);
  }

  private invite(title: string, more: string): void {
    byId("invitation").textContent = title;
    byId("invitation-more").textContent = more;
  }

  /** Show what belongs to a picture, or to there being none. */
  private showWhether(hasPicture: boolean): void {
    document.body.classList.toggle("empty", !hasPicture);
    byId("empty").hidden = hasPicture;
    if (!hasPicture) this.canvas.hidden = byId("command").hidden = true;
    for (const element of document.querySelectorAll<HTMLButtonElement>("[data-needs]")) element.disabled = !hasPicture;
  }

  private show(feed: Feed): void {
    const largest = this.renderer.largestPicture;
    if (Math.max(feed.width, feed.height) > largest)
      throw new api.Refused(`${feed.name} is ${feed.width} × ${feed.height} px; this graphics card takes ${largest} on a side.`);
    if (this.feed !== feed) this.feed?.close();
    this.feed = feed;
    this.playback.follow(feed.video ?? null);
    this.showWhether(true);
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
    banner(problem, "page");
    this.canvas.hidden = byId("command").hidden = problem !== null;
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
    this.renderer.draw(view, this.isRough());
    this.circle.drawView(camera, view);
    byId("command-line").textContent = commandOf(this.store.state, camera, this.feed, view.width, view.height);
    this.level.show(camera, this.canvas);
    this.showFiles(camera, this.feed);
    this.showDoubt(camera, this.feed);
  }

  /** Say where a picture is, and where nothing says how it lies in the circle. */
  private showDoubt(camera: Camera, feed: Feed): void {
    const isGuess = camera.isMoved && !this.store.state.rim;
    const doubt = isGuess ? ". Where the mirror lies in it is a guess: fit the circle, or choose the sensor that took it" : "";
    const text = `${feed.name}, ${feed.width} × ${feed.height} px${doubt}`;
    if (byId("picture-words").textContent !== text) byId("picture-words").textContent = text;
  }

  /** Offer the files that the command needs and no folder holds yet. */
  private showFiles(camera: Camera, feed: Feed): void {
    const sensor = needsFile(camera) ? fittedName(camera) : this.sensor.made?.name;
    byId("save-picture").hidden = !feed.made;
    byId("save-sensor").hidden = !sensor || !this.hasServer;
    const files = [feed.made && feed.name, sensor].filter(Boolean).join(" and ");
    const title = files ? `The same from the command line, once ${files} ${feed.made && sensor ? "are" : "is"} saved` : "The same from the command line";
    if (byId("command-title").textContent !== title) byId("command-title").textContent = title;
  }

  /** While it moves, a view is drawn quickly; once it rests, with care. */
  private isRough(): boolean {
    clearTimeout(this.resting);
    if (this.feed?.moves) return true;
    const rested = performance.now() - this.movedAt;
    if (rested < REST_MS) this.resting = window.setTimeout(() => this.refresh(), REST_MS - rested);
    return rested < REST_MS;
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
    byId("link").addEventListener("click", () => setTimeout(() => void this.copyLink(), 200));
    byId("whole-screen").addEventListener("click", () => void (document.fullscreenElement ? document.exitFullscreen() : byId("stage").requestFullscreen().catch(() => say("This browser does not show it on the full screen."))));
    byId("copy-command").addEventListener("click", () => void copy(byId("command-line").textContent ?? "", "Command"));
    byId("save-sensor").addEventListener("click", () => void this.saveSensor());
    byId("save-picture").addEventListener("click", () => this.feed?.made && save(this.feed.made, this.feed.name));
    this.showWhether(false);
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

  private offerSources(sources: readonly Source[]): void {
    const select = byId<HTMLSelectElement>("sources");
    byId("sources-label").hidden = !sources.length;
    for (const { id, name, kind, command } of sources) {
      const option = Object.assign(document.createElement("option"), { value: id, textContent: name });
      option.dataset.kind = kind;
      option.dataset.command = command;
      select.append(option);
    }
  }

  /** Copy the link, and say what it does not hold. */
  private async copyLink(): Promise<void> {
    const { source, sensor } = this.store.state;
    const missing = [identityIn(source)?.name, sensor.startsWith("file:") ? this.camera?.model.name : null].filter(Boolean).join(" and ");
    const rest = missing ? `. It holds the view, not ${missing}: elsewhere it asks for the file` : source.startsWith("webcam:") ? ". It opens the webcam of whoever opens it" : "";
    await copy(location.href, "Link", rest);
  }

  private async snapshot(): Promise<void> {
    if (!this.ready()) return;
    this.renderer.draw(this.sized()); // what is drawn is gone once the browser has shown it
    const png = await new Promise<Blob | null>((resolve) => this.canvas.toBlob(resolve, "image/png"));
    if (!png) return say("The browser made no picture.");
    const texts = { Software: "omnimirror studio", Comment: byId("command-line").textContent ?? "", Source: this.feed?.name ?? "" };
    save(await withTexts(png, texts), `${this.store.state.mode}.png`);
  }

  private async saveSensor(): Promise<void> {
    const camera = this.camera!;
    const { made } = this.sensor;
    if (made && !needsFile(camera)) return save(made.blob, made.name);
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
    const target = this.targetIn(x, y);
    if (target) this.store.set(panTiltOf(target));
  }

  private dragHorizon(...ends: [PointerEvent, PointerEvent]): void {
    const box = this.canvas.getBoundingClientRect();
    const [from, to] = ends.map((e) => this.targetIn((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height));
    this.movedAt = performance.now();
    if (from && to) this.level.drag(from, to);
  }

  /** What lies at a place of the view, given in parts of its width and height. */
  private targetIn(x: number, y: number): Vec3 | null {
    if (!this.camera) return null;
    const view = this.sized();
    const [u, v] = [x * view.width - 0.5, y * view.height - 0.5];
    const inside = (p: View["parts"][number]): boolean => u >= p.left && v >= p.top && u < p.left + p.width && v < p.top + p.height;
    const part = view.parts.find(inside);
    return (part && targetAt(part, u - part.left, v - part.top)) ?? null;
  }
}

const nameOf = (source: string, sensor: string): string => (source === "room" ? `room of ${sensor}` : source);
