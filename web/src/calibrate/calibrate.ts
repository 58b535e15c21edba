import { background } from "../shared/background";
import * as api from "../shared/api";
import { h } from "../shared/dom";
import type {
  BoardDetection,
  CalibrationOptions,
  CalibrationRequest,
  CalibrationResult,
  MultiImageSummary,
} from "../shared/messages";
import { checkReadable, isVideo } from "../shared/media";
import { framesOf } from "./frames";
import type { Host } from "./host";
import { storeResult, storeSettings, storedResult, storedSettings } from "./storage";
import { BoardPanel } from "./panels/board";
import { CameraPanel, type Rim } from "./panels/camera";
import { RunPanel } from "./panels/run";
import { WebcamPane } from "./panels/webcam";
import { Gallery } from "./results/gallery";
import { coveragePlot } from "./results/plots";
import { list, resultsOf, tablesOf } from "./results/report";
import { ImageDetail } from "./results/image_detail";
import { MAX_IMAGES, type BoardImage, BoardImages } from "./board_images";
import { Toolbar } from "./toolbar";
import { calibrateCommand, rimOf, whyNot } from "./formatting";

/** Stored state of the panels. */
interface Settings {
  board: NonNullable<BoardPanel["board"]>;
  settings: CameraPanel["settings"];
  rim: Rim | null;
}

const RIM_IMAGES = 3; // number of images
const ANALYSIS_DELAY_MS = 150;

/** Tab Calibrate: images of a target, detections, and the estimated camera. */
export class Calibrate {
  readonly images: BoardImages;
  readonly webcam: WebcamPane;
  result: CalibrationResult | null = null;
  report: string | null = null;
  analysis: MultiImageSummary | null = null;
  private chosen: BoardImage | null = null;
  private readonly board: BoardPanel;
  private readonly camera: CameraPanel;
  private readonly run: RunPanel;
  private readonly gallery: Gallery;
  private readonly detail: ImageDetail;
  private readonly toolbar: Toolbar;
  private readonly invitation: HTMLElement;
  private readonly coverage = h("div", {});
  private readonly state = h("div", { className: "plots state" });
  private readonly next = h("section", {
    className: "next",
    "aria-label": "Recommended next image",
    hidden: true,
  });
  private readonly results = h("div", { className: "results" });
  private readonly tables = h("div", { className: "tables" });
  private readonly command = h("code", { tabIndex: 0 });
  private readonly commandRow: HTMLElement;
  private timer = 0;
  private analysisCount = 0;
  private rimTried = 0;

  constructor(
    private readonly host: Host,
    start: CalibrationOptions,
  ) {
    const fail = (e: unknown): void => this.fail(e);
    this.images = new BoardImages({
      board: () => this.board.board,
      changed: () => this.changed(),
      settled: () => background(this.findRim()),
      fail,
    });
    this.gallery = new Gallery((image) => this.choose(image));
    this.detail = new ImageDetail({
      remove: (image) => this.remove(image),
      retry: (image) => this.images.retry(image),
      fail,
    });
    this.webcam = new WebcamPane({
      board: () => this.board.board,
      analysis: (detection) => this.analyse(detection),
      take: (image) => this.take(image, `webcam ${this.images.all.length + 1}.png`),
      closed: () => this.show(),
      fail,
    });
    this.toolbar = new Toolbar(host, {
      add: (files) => background(this.add(files)),
      webcam: () => background(this.webcam.open()),
      clear: () => this.clear(),
      result: () => this.result,
      report: () => this.report,
      look: () => background(this.look()),
    });
    const [boards, cameras, runs] = [panel("Target"), panel("Camera"), panel("Calibration")];
    this.board = new BoardPanel(
      boards,
      start.families,
      () => this.boardChanged(),
      (text) => host.copy(text),
    );
    this.camera = new CameraPanel(cameras, start, () => this.cameraChanged());
    this.run = new RunPanel(runs, {
      request: () => this.calibrationRequest(),
      result: (result) => this.calibrated(result),
      onReport: (report) => this.showReport(report),
    });
    this.invitation = this.invite();
    this.commandRow = h(
      "div",
      { className: "command" },
      h("span", { className: "words" }, "Equivalent command"),
      this.command,
      h(
        "button",
        {
          type: "button",
          className: "small",
          onclick: () => host.copy(this.command.textContent ?? ""),
        },
        "Copy",
      ),
    );
    this.state.append(this.coverage, this.next);
    const plotArea = h(
      "section",
      { className: "desk", tabIndex: -1, "aria-label": "Images and results" },
      this.invitation,
      this.webcam.element,
      this.results,
      this.state,
      this.detail.element,
      this.gallery.element,
      this.tables,
      this.commandRow,
    );
    host.place.append(
      h("aside", { "aria-label": "Target, camera and calibration" }, boards, cameras, runs),
      plotArea,
    );
    this.show();
  }

  /** Restore the stored state. */
  async begin(): Promise<void> {
    const stored = storedSettings<Settings>();
    if (stored?.board && stored.settings) {
      this.board.take(stored.board);
      this.camera.take(stored.settings, stored.rim ?? null);
    }
    const lost = await this.images.restore();
    if (lost.length)
      this.host.banner(
        `The page was closed before ${lost.join(", ")} ${lost.length > 1 ? "were" : "was"} stored; add ${lost.length > 1 ? "them" : "it"} again.`,
        "calibrate",
      );
    const result = await storedResult(this.keys);
    if (result) [this.result, this.report] = [result.result, result.report];
    this.drawResults();
    this.show();
  }

  /** Add images, or the frames of a video. */
  async add(files: readonly File[]): Promise<void> {
    this.host.banner(null, "calibrate");
    const take = (image: Blob, name: string, time: number | null): Promise<boolean> =>
      this.take(image, name, time);
    const refusals: string[] = [];
    for (const file of files) {
      try {
        await checkReadable(file, file.name);
        if (isVideo(file, file.name))
          await framesOf(file, file.name, MAX_IMAGES - this.images.all.length, take);
        else if (!(await take(file, file.name, null))) {
          refusals.push(
            `${MAX_IMAGES} images is the maximum; ${file.name} and the following files were ignored.`,
          );
          break;
        }
      } catch (e) {
        if (e instanceof api.RequestRejected) refusals.push(e.message);
        else this.fail(e);
      }
    }
    if (refusals.length) this.host.banner(refusals.join(" "), "calibrate");
  }

  private async take(image: Blob, name: string, time: number | null = null): Promise<boolean> {
    this.drop();
    return this.images.add(image, name, time);
  }

  private remove(image: BoardImage): void {
    if (this.chosen === image) this.chosen = null;
    this.drop();
    this.images.remove(image);
  }

  private clear(): void {
    this.chosen = null;
    this.drop();
    this.camera.showRim(null);
    this.rimTried = 0;
    this.images.clear();
  }

  private choose(image: BoardImage | null): void {
    this.chosen = this.chosen === image ? null : image;
    this.show();
    if (this.chosen) this.detail.element.scrollIntoView({ block: "nearest" });
  }

  // -- changes of the input -------------------------------------------------------------------------

  private boardChanged(): void {
    if (!this.board.board) return this.show();
    if (this.images.again()) this.drop();
    this.keep();
    this.show();
  }

  private cameraChanged(): void {
    this.drop();
    this.changed();
    this.keep();
  }

  /** Discard the result, which is valid for its images only. */
  private drop(): void {
    this.run.forget();
    if (!this.result) return;
    [this.result, this.report] = [null, null];
    this.drawResults();
    this.keep();
  }

  private changed(): void {
    this.show();
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => background(this.compare()), ANALYSIS_DELAY_MS);
  }

  /** Request the joint analysis of the images. */
  private async compare(): Promise<void> {
    const detected = this.images.all.filter((s) => s.detection !== null);
    const number = ++this.analysisCount;
    if (!detected.length || !this.board.board) {
      if (!this.images.waiting) this.analysis = null;
      return this.show();
    }
    try {
      const analysis = await this.analyse(null);
      if (number !== this.analysisCount) return;
      this.analysis = analysis;
      detected.forEach((image, i) => (image.reason = analysis.reasons[i] ?? null));
    } catch (e) {
      if (number === this.analysisCount) this.fail(e);
    }
    this.show();
  }

  private analyse(candidate: BoardDetection | null): Promise<MultiImageSummary> {
    const { rim } = this.camera;
    const detections = this.images.all.flatMap((s) => (s.detection ? [s.detection] : []));
    return api.analysis({
      board: this.board.board!,
      detections,
      centre_px: rim?.centre ?? null,
      radius_px: rim?.radius ?? null,
      candidate,
    });
  }

  /** Detect the mirror rim in the first images with a target. */
  private async findRim(): Promise<void> {
    const detected = this.images.result.slice(0, RIM_IMAGES);
    if (!this.camera.isMirror || detected.length <= this.rimTried || this.rimTried >= RIM_IMAGES)
      return;
    this.rimTried = detected.length;
    try {
      const rim = rimOf(
        await Promise.all(detected.map((image) => api.outline(image.blob, image.name))),
      );
      this.camera.showRim(rim, detected.length);
      this.changed();
      this.keep();
    } catch (e) {
      if (!(e instanceof api.RequestRejected)) this.fail(e); // calibration does not require a rim
    }
  }

  // -- calibration ----------------------------------------------------------------------------------

  private calibrationRequest(): { ask: CalibrationRequest; detections: BoardDetection[] } | null {
    const { board } = this.board;
    const detections = this.images.all.flatMap((s) => (s.detection ? [s.detection] : []));
    if (!board || !detections.length) return null;
    return {
      ask: {
        board,
        ...this.camera.settings,
        images: detections.length,
        command: this.commandLine(),
      },
      detections,
    };
  }

  private calibrated(result: CalibrationResult): void {
    this.result = result;
    this.report = null;
    this.drawResults();
    this.show();
    this.keep();
    this.results.scrollIntoView({ block: "start" });
  }

  private showReport(report: string): void {
    this.report = report;
    this.show();
    this.keep();
  }

  /** Open the selected image, or the first used one, with the calibrated camera in the tab Look. */
  private async look(): Promise<void> {
    const { result } = this;
    const image =
      this.chosen ??
      this.images.all.find((s) => result?.images.find((p) => p.name === s.name)?.used);
    if (!result || !image) return;
    try {
      await this.host.lookThrough(
        new Blob([result.camera_file], { type: "application/toml" }),
        "camera.toml",
        image.blob,
        image.name,
      );
    } catch (e) {
      this.fail(e);
    }
  }

  // -- display --------------------------------------------------------------------------------------

  private show(): void {
    const { all } = this.images;
    const isEmpty = !all.length && !this.webcam.isOpen;
    this.invitation.hidden = !isEmpty;
    this.commandRow.hidden = !all.length;
    this.run.show(
      this.board.board
        ? whyNot(this.images.result.length, this.images.waiting)
        : "Specify the target first.",
    );
    this.gallery.show(all, this.chosen);
    this.detail.show(this.chosen, this.camera.isMirror ? this.camera.rim : null, this.result);
    this.toolbar.show(all.length > 0);
    this.command.textContent = this.commandLine();
    this.drawCoverage();
  }

  private drawCoverage(): void {
    const shown = this.result?.coverage ?? this.analysis?.coverage ?? null;
    const used = this.images.result;
    if (!used.length && this.images.waiting) return; // buttons are not recreated during detection, so that a press is not lost
    this.coverage.hidden = !shown || !used.length;
    if (shown && used.length)
      this.coverage.replaceChildren(
        coveragePlot(
          shown,
          used[0].detection!.image_size,
          used.flatMap((s) => s.detection!.corners_px),
          this.camera.isMirror ? this.camera.rim : null,
        ),
      );
    const advice = used.length ? (this.result?.advice ?? this.analysis?.advice ?? []) : [];
    this.next.hidden = !advice.length;
    this.state.hidden = this.coverage.hidden && this.next.hidden;
    this.next.replaceChildren(h("h3", {}, "Next"), list("advice", advice));
  }

  private drawResults(): void {
    const choose = (name: string): void => {
      this.chosen = null;
      this.choose(this.images.all.find((s) => s.name === name) ?? null);
    };
    this.results.replaceChildren(...(this.result ? resultsOf(this.result) : []));
    this.tables.replaceChildren(...(this.result ? tablesOf(this.result, choose) : []));
  }

  private commandLine(): string {
    const { board } = this.board;
    const files = this.images.all.filter((s) => s.time === null).map((s) => s.name);
    const videos = [
      ...new Set(
        this.images.all
          .filter((s) => s.time !== null)
          .map((s) => s.name.replace(/ at [\d.]+ s$/, "")),
      ),
    ];
    return board ? calibrateCommand([...files, ...videos], { board, ...this.camera.settings }) : "";
  }

  private invite(): HTMLElement {
    return h(
      "div",
      { className: "invitation" },
      h("h2", {}, "Drop images of a target here"),
      h(
        "p",
        {},
        "10 to 20 images of one target, distributed over the field and tilted, or a video. They remain on this machine.",
      ),
      h(
        "p",
        { className: "choices" },
        h(
          "button",
          { type: "button", className: "primary", onclick: () => this.toolbar.open() },
          "Choose images…",
        ),
        h(
          "button",
          { type: "button", onclick: () => background(this.webcam.open()) },
          "Use the webcam",
        ),
      ),
    );
  }

  private get keys(): string[] {
    return this.images.all.map((s) => s.key);
  }

  private keep(): void {
    const { board } = this.board;
    if (board)
      storeSettings({
        board,
        settings: this.camera.settings,
        rim: this.camera.rim,
      } satisfies Settings);
    background(storeResult(this.keys, this.result, this.report));
  }

  private fail(e: unknown): void {
    if (api.isUserError(e))
      this.host.banner(e.message, e.name === "ServerUnavailable" ? "server" : "calibrate");
    else reportError(e);
  }
}

const panel = (title: string): HTMLElement =>
  h("section", { className: "panel", "aria-label": title }, h("h2", {}, title));
