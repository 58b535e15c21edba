import { background } from "../shared/background";
import { byId, choices, hideComputed, put } from "../shared/dom";
import { banner, say } from "../shared/notices";
import { INITIAL, type Mode, type State } from "../shared/state";
import type { Store } from "../shared/store";
import { commandOf, fittedName, needsFile, viewRequest } from "./command";
import { Drawing } from "./drawing/drawing";
import type { Renderer } from "./drawing/renderer";
import { embedded, floats } from "./embedded";
import type { Feed, CameraFeed } from "./feeds/feed";
import { AdditionalImages } from "./feeds/additional_images";
import { Recorder } from "./feeds/recorder";
import { Camera } from "./geometry/camera";
import { panTiltOf, type Pixel, type Vec3 } from "../shared/vectors";
import { aspectOf, targetIn, type View, viewOf } from "./geometry/views";
import { CirclePane } from "./panels/circle";
import { CameraQuestion, type Thumbnail } from "./panels/camera_question";
import { Gestures } from "./panels/gestures";
import { GyroscopePanel } from "./panels/gyroscope";
import { LevelPanel } from "./panels/level";
import { MeasurePanel } from "./panels/measure";
import { hasSize, RimPanel } from "./panels/rim";
import { SensorPanel } from "./panels/sensor";
import { bindSliders } from "./panels/sliders";
import { KINDS, ViewsPanel } from "./panels/views";
import { type DisplayedView, ExportMenu } from "./panels/export";
import { DisplayPanel } from "./panels/display";
import { endMode } from "./panels/view_mode";
import { RestorationPanel } from "./panels/restoration";
import { Sources } from "./sources";
import { type Layout, layOut, type Place } from "./stage";
import * as supply from "./data_source";
import { explainWords } from "./term_tooltips";
import { Toolbar } from "./toolbar";

const REST_MS = 120; // idle time after which a view is drawn with full quality

/** Tab Look: image, camera, view, and their controls. */
export class Look {
  readonly sensor: SensorPanel;
  readonly sources: Sources;
  private readonly canvas = byId("view");
  private readonly drawing: Drawing;
  private readonly circle: CirclePane;
  private readonly rim: RimPanel;
  private readonly level: LevelPanel;
  private readonly measure: MeasurePanel;
  private readonly recorder: Recorder;
  private readonly views: ViewsPanel;
  private readonly first: CameraQuestion;
  private readonly wipe: RestorationPanel;
  private readonly additional: AdditionalImages;
  private layout: Layout | null = null;
  private camera: Camera | null = null;
  private isDirty = false;
  private isImageNew = false;
  private movedAt = 0;
  private resting = 0;

  constructor(private readonly store: Store) {
    this.drawing = new Drawing(
      this.canvas,
      () => this.refresh(true),
      () => this.recorder.stop(),
    );
    this.circle = new CirclePane(
      (pixel) => this.lookAtPixel(pixel),
      (c) => this.rim.set(c),
    );
    this.rim = new RimPanel(
      store,
      () => this.feed,
      (isFitting) => this.fitting(isFitting),
    );
    this.views = new ViewsPanel(store, () => this.sources.offered);
    this.wipe = new RestorationPanel(store, () => this.restored());
    new DisplayPanel(store, () => this.placeCircle());
    new GyroscopePanel(store);
    new ExportMenu(() => this.displayed());
    this.sensor = new SensorPanel(store, {
      changed: () => this.refresh(true),
      prepare: (requested) => this.sources.prepare(requested),
    });
    this.sources = new Sources(store, {
      maximum: this.renderer.maxImageSide,
      changed: () => this.sourceChanged(),
      take: (source) => this.additional.take(source),
      give: (source, feed) => this.additional.give(source, feed),
      opened: (feed) => background(this.first.look(feed)),
      closed: () => {
        this.rim.cancelSearch();
        endMode();
      },
      calibrated: (file, name) => this.sensor.load(file, name),
    });
    this.additional = new AdditionalImages({
      open: (source, signal) => this.sources.feedNamed(source, signal),
      fetch: (s) => this.sensor.fetch(s),
      fit: (camera, feed, rim) => this.rim.fit(camera, feed, rim),
      states: () => this.views.additional(),
      changed: () => this.refresh(),
    });
    this.first = new CameraQuestion(store, {
      rim: this.rim,
      sensor: () => this.sensor,
      feed: () => this.feed,
      level: () => this.level.find(false),
      draw: (thumbnails) => this.drawThumbnails(thumbnails),
    });
    this.level = new LevelPanel(
      store,
      () => this.sensor,
      () => this.refresh(),
    );
    this.measure = new MeasurePanel(store, this.canvas, () => this.refresh());
    this.recorder = new Recorder(
      () => this.renderer.canvas,
      () => this.refresh(),
    );
    new Toolbar(store, {
      sources: this.sources,
      sensor: this.sensor,
      camera: () => this.camera,
      drawn: () => this.drawn(),
      commands: () => this.commands(),
    });
    this.bindMoving();
    store.listen(() => {
      this.movedAt = performance.now();
      this.refresh();
    });
    this.placeCircle();
    new ResizeObserver(() => this.refresh()).observe(byId("pane"));
    new ResizeObserver(() => this.refresh(true)).observe(byId("circle"));
  }

  get renderer(): Renderer {
    return this.drawing.renderer;
  }

  /** Current source. */
  get feed(): Feed | null {
    return this.sources.feed;
  }

  /** Start with the sources of the server and the state of the address. */
  async begin(): Promise<void> {
    if (supply.alone) {
      hideComputed(document);
      byId("alone-words").hidden = false;
    }
    const start = await supply.start();
    this.sensor.offer(start.sensors);
    this.sources.offer(start.sources);
    const fresh = !location.hash;
    if (!this.store.state.source && start.source)
      this.store.set({ source: `server:${start.source}` }, false);
    if (fresh && start.sensor) this.store.set({ sensor: start.sensor }, false);
    if (start.sensor) this.first.known();
    await this.sensor.want();
    await this.sources.begin();
    if (fresh && this.feed) background(this.first.look(this.feed));
  }

  /** Resume what an outage of the server interrupted. */
  async resume(): Promise<void> {
    if (!this.sensor.camera) return this.begin();
    await this.sources.resume();
    await this.first.resume();
  }

  /** Start with an embedded image and camera. */
  async beginEmbedded(): Promise<void> {
    const inside = embedded()!;
    for (const element of document.querySelectorAll<HTMLElement>("[data-server], [data-opens]"))
      element.hidden = true;
    byId("sources-label").hidden = true;
    this.sensor.take(new Camera(inside.camera, floats(inside.tables)));
    await this.sources.beginEmbedded(inside.media, inside.name);
  }

  /** Return the view of the state with a given size in pixels, for tests and scripts. */
  viewIn(width: number, height: number): { view: View; command: string } {
    const camera = this.ready()!;
    const view = viewOf(this.store.state, camera, width, height);
    return {
      view,
      command: commandOf(this.store.state, camera, this.feed!, view.width, view.height),
    };
  }

  // -- drawing ------------------------------------------------------------------------------------

  private refresh(isImageNew = false): void {
    this.isImageNew ||= isImageNew;
    if (this.isDirty) return;
    this.isDirty = true;
    requestAnimationFrame(() => {
      this.isDirty = false;
      this.draw();
      if (this.recorder.isRunning) this.refresh();
    });
  }

  private sourceChanged(): void {
    if (!this.feed) return this.circle.clear();
    this.refresh(true);
    this.follow(this.feed);
  }

  /** Redraw for each new frame while the source is displayed; paused videos are not redrawn. */
  private follow(feed: Feed): void {
    feed.next?.(() => {
      if (feed !== this.feed) return;
      this.refresh(true);
      this.follow(feed);
    });
  }

  /** Pass camera and image to the renderer; null if there is nothing to display. */
  private ready(): Camera | null {
    const { feed } = this;
    if (feed && this.isImageNew) this.circle.drawImage(feed);
    if (!this.sensor.camera) return null;
    const camera = (this.camera = this.rim.fit(this.sensor.camera, feed));
    this.rim.show(camera);
    if (!feed) return null;
    const problem = problemOf(camera, feed);
    banner(problem, "page");
    this.canvas.hidden = byId("command").hidden = problem !== null;
    if (problem) return null;
    this.renderer.setCamera(camera);
    if (this.isImageNew) this.renderer.setImage(feed.image, feed.width, feed.height);
    if (this.isImageNew) this.renderer.setRestored(this.wipe.image);
    this.isImageNew = false;
    return camera;
  }

  private draw(): void {
    const camera = this.ready();
    if (!camera || !this.feed) return;
    const { view, places } = this.layOut();
    this.wipe.follow(camera, this.feed, this.canvas);
    this.paint(this.isRough());
    this.circle.drawView(camera, view);
    put("command-line", this.command(this.place));
    this.level.follow(camera, this.feed);
    this.level.show(camera, this.canvas, this.place);
    this.measure.show(
      this.place,
      places.map(({ cameraFeed }) => cameraFeed?.feed),
    );
    this.views.label(places, this.canvas, (s) => this.additional.doubt(s));
    this.showFiles(camera, this.feed);
    this.showDoubt(camera, this.feed);
  }

  /** Redraw with full quality; return the canvas, or null if there is no image. */
  private drawn(): HTMLCanvasElement | null {
    if (!this.ready()) return null;
    this.layOut();
    this.paint(false);
    return this.renderer.canvas;
  }

  /** Draw all views: those of the main image, then those of others. */
  private paint(isRough: boolean): void {
    const { view, places } = this.layout!;
    this.renderer.draw(view, isRough, this.wipe.share);
    for (const { cameraFeed, state, parts } of places)
      if (cameraFeed && cameraFeed.camera !== this.camera)
        this.renderer.add({ ...view, parts }, cameraFeed, state.source);
    this.renderer.retainImages(places.map(({ state }) => state.source));
  }

  /** Draw panoramas of the image with other cameras, in one pass below each other. */
  private drawThumbnails(thumbnails: readonly Thumbnail[]): void {
    const { feed } = this;
    if (!feed) return;
    if (!this.ready()) this.renderer.setImage(feed.image, feed.width, feed.height); // the selected sensor does not fit the image
    let top = 0;
    const views = thumbnails.map(({ canvas, camera: other, pan }) => {
      const camera = this.rim.fit(other, feed);
      const state: State = { ...INITIAL, fit: "whole", pan };
      canvas.height = Math.round(canvas.width / aspectOf(state, camera)!);
      const { parts } = viewOf(state, camera, canvas.width, canvas.height);
      const view = { canvas, camera, top, parts: parts.map((part) => ({ ...part, top })) };
      top += canvas.height;
      return view;
    });
    this.renderer.drawSheet(views, Math.max(...views.map(({ canvas }) => canvas.width)), top);
    for (const { canvas, top: from } of views)
      canvas.getContext("2d")!.drawImage(this.renderer.canvas, 0, -from);
    this.refresh();
  }

  private restored(): void {
    this.renderer.setRestored(this.wipe.image);
    this.refresh();
  }

  /** Return the active view with its image and camera; null without an image. */
  private displayed(): DisplayedView | null {
    const camera = this.ready();
    if (!camera || !this.feed) return null;
    const { state, view, cameraFeed } = this.place;
    const shown = cameraFeed ?? { camera, feed: this.feed };
    return { ...shown, view: viewRequest(state, shown.camera, view.width, view.height) };
  }

  private command({ state, view, cameraFeed }: Place): string {
    const { camera, feed } = cameraFeed ?? { camera: this.camera!, feed: this.feed! };
    return commandOf(state, camera, feed, view.width, view.height);
  }

  /** Return the command lines of all displayed views. */
  private commands(): string {
    return this.layOut()
      .places.map((place) => this.command(place))
      .join("\n");
  }

  /** Display image name and size, and a warning if the position of the circle is assumed. */
  private showDoubt(camera: Camera, feed: Feed): void {
    const isGuess = camera.isMoved && !this.store.state.rim;
    const doubt = isGuess
      ? ". The position of the mirror is assumed: fit the circle, or select the sensor of this image"
      : "";
    put(
      "image-info",
      `${feed.name}, ${feed.width} × ${feed.height} px${doubt || this.rim.words(feed)}`,
    );
  }

  /** Offer unsaved files that the command requires. */
  private showFiles(camera: Camera, feed: Feed): void {
    const sensor = needsFile(camera) ? fittedName(camera) : this.sensor.createdFile?.name;
    byId("save-image").hidden = !feed.renderedFile;
    byId("save-sensor").hidden = !sensor || !this.sources.hasServer;
    const files = [feed.renderedFile && feed.name, sensor].filter(Boolean).join(" and ");
    const once = files ? ` (save ${files} first)` : "";
    put("command-title", `Equivalent command${once}`);
  }

  /** Draw with fewer samples while the view moves. */
  private isRough(): boolean {
    clearTimeout(this.resting);
    if (this.layout?.places.some(({ cameraFeed }) => cameraFeed?.feed.moves)) return true;
    const rested = performance.now() - this.movedAt;
    if (rested < REST_MS) this.resting = window.setTimeout(() => this.refresh(), REST_MS - rested);
    return rested < REST_MS;
  }

  /** Lay out the views in the available area. */
  private layOut(): Layout {
    const { width, height } = byId("pane").getBoundingClientRect();
    const shown: CameraFeed = { camera: this.camera!, feed: this.feed! };
    this.additional.hold();
    const states = this.views.states();
    const cameraFeed = states.map((s) =>
      this.views.isOther(s) ? this.additional.seenBy(s) : shown,
    );
    return (this.layout = layOut(states, cameraFeed, shown.camera, this.canvas, { width, height }));
  }

  /** Active view. */
  private get place(): Place {
    const { places } = this.layout ?? this.layOut();
    return places[Math.min(this.views.active, places.length - 1)];
  }

  /** Return the position of the active view on the screen. */
  private box(): DOMRect {
    const { left, top } = this.canvas.getBoundingClientRect();
    const { place } = this;
    return new DOMRect(left + place.left, top + place.top, place.width, place.height);
  }

  // -- navigation -----------------------------------------------------------------------------------

  private bindMoving(): void {
    const { store } = this;
    const horizon = {
      isDragged: () => this.level.isDragged(),
      drag: (from: PointerEvent, to: PointerEvent) => this.dragHorizon(from, to),
      settle: () => this.sensor.settleTilt(),
    };
    const shown = {
      box: () => this.box(),
      choose: (e: PointerEvent) =>
        this.views.chooseAt(this.layout?.places ?? [], e.offsetX, e.offsetY),
    };
    const gestures = new Gestures(
      this.canvas,
      store,
      () => this.camera,
      (x, y) => this.lookAtView(x, y),
      () => this.sources.playback.toggle(),
      horizon,
      shown,
    );
    const glide = byId<HTMLInputElement>("glide");
    glide.checked = gestures.glides;
    glide.addEventListener("change", () => (gestures.glides = glide.checked));
    const show = choices<Mode>(byId("modes"), "mode", KINDS, (mode) => store.set({ mode }));
    show(store.state.mode);
    store.listen((s, changed) => changed.has("mode") && show(s.mode));
    bindSliders(store);
    explainWords();
  }

  /** Display the image circle in the large pane for fitting, or move it back. */
  private fitting(isFitting: boolean): void {
    this.circle.isFitting = isFitting;
    document.body.classList.toggle("fitting", isFitting);
    this.placeCircle();
    if (isFitting) byId("frame").scrollIntoView({ block: "nearest" });
    this.refresh(true);
  }

  private placeCircle(): void {
    const { beside } = this.store.state;
    document.body.classList.toggle("beside", beside);
    if (beside || this.circle.isFitting) byId("frame").prepend(byId("circle"));
    else byId("raw-place").append(byId("circle"));
  }

  private lookAtPixel(pixel: Pixel): void {
    const direction = this.camera?.backproject(pixel);
    if (!direction) return say("This point is outside the field of view of the sensor.");
    this.store.set(panTiltOf(direction));
    if (this.store.state.mode !== "perspective")
      say("Centred horizontally; select Perspective to centre the point in both directions.");
  }

  /** Centre the view on a point given as fractions of width and height. */
  private lookAtView(x: number, y: number): void {
    const target = this.targetAt(x, y);
    if (target) this.store.set(panTiltOf(target));
  }

  private dragHorizon(...ends: [PointerEvent, PointerEvent]): void {
    const box = this.box();
    const [from, to] = ends.map((e) =>
      this.targetAt((e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height),
    );
    this.movedAt = performance.now();
    if (from && to) this.level.drag(from, to);
  }

  /** Return the target at a point given as fractions of width and height. */
  private targetAt(x: number, y: number): Vec3 | null {
    if (!this.camera) return null;
    const { view } = this.place;
    return targetIn(view, x * view.width - 0.5, y * view.height - 0.5);
  }
}

/** Return the reason for which the camera does not fit the image; null if it does. */
function problemOf({ model }: Camera, feed: Feed): string | null {
  if (model.is_adjustable || hasSize(model, [feed.width, feed.height])) return null;
  const [w, h] = model.image_size;
  return `${feed.name} has ${feed.width} × ${feed.height} px, but ${model.name} requires images of ${w} × ${h} px. Select the sensor of this image.`;
}
