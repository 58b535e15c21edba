import { background } from "../../shared/background";
import * as api from "../../shared/api";
import { byId, choices } from "../../shared/dom";
import { checkReadable } from "../../shared/media";
import type { SensorEntry } from "../../shared/messages";
import { banner, busy, fail, say } from "../../shared/notices";
import { INITIAL, type CameraOrientation, type State } from "../../shared/state";
import type { Store } from "../../shared/store";
import { keep, stored, type Stored } from "../feeds/image_storage";
import { Camera } from "../geometry/camera";
import type { Tilt } from "../geometry/tilt";
import * as supply from "../data_source";

/** Part of the state that determines the camera and its mount. */
type Chosen = Pick<State, (typeof CHOSEN)[number]>;

/** Interface of the page for the panel. */
interface Callbacks {
  /** Called when the camera changes. */
  changed: () => void;
  /** Prepare other data of a new sensor; returns a function that displays them, or null. */
  prepare: (requested: State) => Promise<(() => void) | null>;
}

const MAX_CACHED = 16; // number of cached cameras; several MB each without rotational symmetry

/** Selection and mount of a sensor, and its calibration file. */
export class SensorPanel {
  private readonly select = byId<HTMLSelectElement>("sensor");
  private readonly showLooks: (looks: CameraOrientation) => void;
  private readonly showOptics: (optics: Optics) => void;
  private readonly had = new Map<string, Camera>();
  private request = 0;
  private chosen: Chosen | null = null;
  camera: Camera | null = null;
  /** Camera as loaded from the server; the displayed one can have another tilt while the horizon is dragged. */
  private loadedCamera: Camera | null = null;
  /** File of a sensor that was created by the page. */
  createdFile: Stored | null = null;

  constructor(
    private readonly store: Store,
    private readonly callbacks: Callbacks,
  ) {
    const looks = [
      ["up", "up"],
      ["down", "down"],
      ["forward", "forward"],
    ] as const;
    this.showLooks = choices<CameraOrientation>(byId("looks"), "looks", looks, (value) =>
      background(this.want({ looks: value, pitch: null, roll: null })),
    ); // tilt depends on the orientation
    const optics = [
      ["mirror", "mirror"],
      ["fisheye", "fisheye"],
    ] as const;
    this.showOptics = choices<Optics>(byId("optics"), "optics", optics, (value) =>
      background(this.loadAgain(value)),
    );
    this.select.addEventListener("change", () =>
      background(this.want({ sensor: this.select.value, ...AS_IN_FILE })),
    );
    byId("load").addEventListener("click", () => byId<HTMLInputElement>("calibration").click());
    byId<HTMLInputElement>("calibration").addEventListener("change", (e) => {
      const input = e.target as HTMLInputElement;
      if (input.files?.[0]) background(this.load(input.files[0], input.files[0].name));
      input.value = "";
    });
    const ball = byId<HTMLInputElement>("ball-field");
    ball.addEventListener(
      "change",
      () => ball.checkValidity() && background(this.want({ sensor: `ball:${+ball.value}` })),
    );
    const forward = byId<HTMLInputElement>("forward");
    forward.addEventListener(
      "change",
      () => forward.checkValidity() && background(this.want({ forward: +forward.value })),
    );
    for (const key of ["pitch", "roll"] as const) {
      const input = byId<HTMLInputElement>(key);
      input.addEventListener(
        "change",
        () => input.checkValidity() && background(this.want({ [key]: +input.value })),
      );
    }
    const flipped = byId<HTMLInputElement>("flipped");
    flipped.addEventListener("change", () => background(this.want({ flipped: flipped.checked })));
    store.listen(
      (_, changed) =>
        this.chosen && CHOSEN.some((key) => changed.has(key)) && background(this.want()),
    );
  }

  /** List the cameras of the server. */
  offer(entries: SensorEntry[]): void {
    this.select.replaceChildren(...entries.map((e) => this.option(e)));
  }

  /** Read a calibration file and select it; `isMade` for a sensor from the Design tab. */
  async load(file: Blob, name: string, optics: Optics = "mirror", isMade = false): Promise<void> {
    try {
      await checkReadable(file, name);
      const entry = await api.loadSensor(file, name, optics);
      await keep(entry.id, { blob: file, name, optics, isMade });
      if (await this.want({ sensor: entry.id, ...AS_IN_FILE }, !isMade))
        say(`${entry.name} loaded`);
    } catch (e) {
      fail(e, "sensor");
    }
  }

  /** Reload the file with a given type of optics, which OCamCalib files do not contain. */
  private async loadAgain(optics: Optics): Promise<void> {
    const file = await stored(this.store.state.sensor);
    if (file) await this.load(file.blob, file.name, optics);
  }

  /** Select another sensor or mount; name, view and address change together when all data are loaded. */
  async want(change: Partial<State> = {}, addsHistory = true): Promise<boolean> {
    const requested = { ...this.store.state, ...change };
    const number = ++this.request;
    if (this.loadedCamera && this.chosen && isSame(requested, this.chosen)) {
      if (this.camera !== this.loadedCamera) this.take(this.loadedCamera);
      busy(null);
      this.store.set(change, addsHistory);
      return true;
    }
    if (this.camera) this.show(this.camera); // until then, controls describe the displayed camera
    busy("Loading the sensor…");
    try {
      const [camera, show] = await Promise.all([
        this.fetch(requested),
        this.callbacks.prepare(requested),
      ]);
      const file = await stored(requested.sensor);
      if (number !== this.request) return false;
      this.chosen = Object.fromEntries(CHOSEN.map((key) => [key, requested[key]])) as Chosen;
      this.createdFile = file?.isMade ? file : null;
      show?.();
      this.take(camera);
      busy(null);
      banner(null, "sensor");
      this.store.set(change, addsHistory);
      return true;
    } catch (e) {
      if (number === this.request) await this.stay(e, requested.sensor);
      return false;
    }
  }

  /** Keep the current sensor after a failure; without one, select the default. */
  private async stay(e: unknown, sensor: string): Promise<void> {
    fail(e, "sensor");
    if (this.chosen && this.loadedCamera) {
      this.take(this.loadedCamera);
      this.store.set(this.chosen, false);
    } else if (
      e instanceof api.RequestRejected &&
      sensor !== INITIAL.sensor &&
      (await this.want({ sensor: INITIAL.sensor, ...AS_IN_FILE }, false))
    )
      fail(e, "sensor");
  }

  /** Return the camera of a state from the cache, or load it from the server. */
  async fetch(requested: Chosen): Promise<Camera> {
    const name = JSON.stringify(CHOSEN.map((key) => requested[key]));
    const camera = this.had.get(name) ?? (await this.fetchAnew(requested));
    this.had.delete(name);
    this.had.set(name, camera); // most recently used last
    if (this.had.size > MAX_CACHED) this.had.delete(this.had.keys().next().value!);
    return camera;
  }

  private async fetchAnew({
    sensor,
    looks,
    forward,
    flipped,
    pitch,
    roll,
  }: Chosen): Promise<Camera> {
    const request = {
      id: sensor,
      camera_looks: looks,
      forward_azimuth_deg: forward,
      image_flipped: flipped,
      pitch_deg: pitch,
      roll_deg: roll,
    };
    const { model, tables } = await supply.camera(request).catch(async (e: unknown) => {
      const file = await stored(sensor);
      if (!(e instanceof api.RequestRejected) || supply.alone) throw e;
      if (!file) throw sensor.startsWith("file:") ? new api.RequestRejected(ELSEWHERE) : e;
      await api.loadSensor(file.blob, file.name, file.optics); // the server was restarted
      return api.camera(request);
    });
    return new Camera(model, tables);
  }

  take(camera: Camera): void {
    this.camera = this.loadedCamera = camera;
    this.show(camera);
    this.callbacks.changed();
  }

  /** Set another tilt temporarily, while the horizon is dragged. */
  tilt(to: Tilt): void {
    if (!this.camera) return;
    this.camera = this.camera.tilted(to);
    this.show(this.camera);
    this.callbacks.changed();
  }

  /** Load the camera with the current tilt. */
  settleTilt(): void {
    const mount = this.camera?.model.mount;
    if (mount)
      background(
        this.want({ pitch: +mount.pitch_deg.toFixed(2), roll: +mount.roll_deg.toFixed(2) }),
      );
  }

  private show({ model }: Camera): void {
    byId("sensor-words").textContent =
      `${model.title.replace(/\.$/, "")}. Elevation ${model.tilt_min_deg.toFixed(0)}° to ${model.tilt_max_deg.toFixed(0)}°.`;
    this.select.value = model.id;
    if (this.select.value !== model.id) this.add(model);
    this.showLooks(model.mount.camera_looks);
    byId<HTMLInputElement>("forward").value = String(model.mount.forward_azimuth_deg);
    byId<HTMLInputElement>("flipped").checked = model.mount.image_flipped;
    for (const key of ["pitch", "roll"] as const) {
      const input = byId<HTMLInputElement>(key);
      if (document.activeElement !== input)
        input.value = String(+model.mount[`${key}_deg`].toFixed(2));
    }
    const [kind, field] = model.id.split(":");
    byId("optics-row").hidden = model.kind !== "ocam" || !model.id.startsWith("file:");
    if (model.kind === "ocam")
      this.showOptics(model.options.includes("camera.optics=fisheye") ? "fisheye" : "mirror");
    byId("ball-row").hidden = kind !== "ball" || supply.alone !== null;
    if (kind === "ball") byId<HTMLInputElement>("ball-field").value = field;
  }

  private add(entry: { id: string; name: string; title: string; kind: SensorEntry["kind"] }): void {
    const group =
      entry.kind === "ball"
        ? [...this.select.options].find((o) => o.value.startsWith("ball:"))
        : null;
    if (group) group.replaceWith(this.option(entry));
    else if (![...this.select.options].some((o) => o.value === entry.id))
      this.select.append(this.option(entry));
    this.select.value = entry.id;
  }

  private option(entry: { id: string; name: string; title: string }): HTMLOptionElement {
    return Object.assign(document.createElement("option"), {
      value: entry.id,
      textContent: entry.name,
      title: entry.title,
    });
  }
}

type Optics = NonNullable<Stored["optics"]>;

const ELSEWHERE =
  "This link requires a sensor file that is not stored in this browser; links contain the view, not the file. Select the file with Load…";
const isSame = (a: Chosen, b: Chosen): boolean => CHOSEN.every((key) => a[key] === b[key]);
const CHOSEN = ["sensor", "looks", "forward", "flipped", "pitch", "roll"] as const;
/** Mount of the file, and no circle. */
export const AS_IN_FILE = {
  rim: null,
  looks: null,
  forward: null,
  flipped: null,
  pitch: null,
  roll: null,
} as const;
