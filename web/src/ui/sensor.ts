import * as api from "../api";
import type { SensorEntry } from "../messages";
import { Camera } from "../model/camera";
import type { Looks, Store } from "../state";
import { byId, choices, say } from "./dom";
import { keep, kept, type Kept } from "./kept";

/** Choosing a sensor, saying how it stood, and fitting its circle to the picture. */
export class SensorPanel {
  private readonly select = byId<HTMLSelectElement>("sensor");
  private readonly showLooks: (looks: Looks) => void;
  private readonly showOptics: (optics: Optics) => void;
  private asked = 0;
  camera: Camera | null = null;

  constructor(private readonly store: Store, private readonly changed: () => void, private readonly failed: (e: unknown) => void) {
    const looks = [["up", "up"], ["down", "down"], ["forward", "ahead"]] as const;
    this.showLooks = choices<Looks>(byId("looks"), "looks", looks, (value) => store.set({ looks: value }));
    const optics = [["mirror", "a mirror"], ["fisheye", "a fisheye"]] as const;
    this.showOptics = choices<Optics>(byId("optics"), "optics", optics, (value) => void this.loadAgain(value));
    this.select.addEventListener("change", () => store.set({ sensor: this.select.value, ...AS_IN_FILE }));
    byId("load").addEventListener("click", () => byId<HTMLInputElement>("calibration").click());
    byId<HTMLInputElement>("calibration").addEventListener("change", (e) => {
      const input = e.target as HTMLInputElement;
      if (input.files?.[0]) void this.load(input.files[0], input.files[0].name);
      input.value = "";
    });
    const ball = byId<HTMLInputElement>("ball-field");
    ball.addEventListener("change", () => ball.checkValidity() && store.set({ sensor: `ball:${+ball.value}` }));
    const forward = byId<HTMLInputElement>("forward");
    forward.addEventListener("change", () => forward.checkValidity() && store.set({ forward: +forward.value }));
    const flipped = byId<HTMLInputElement>("flipped");
    flipped.addEventListener("change", () => store.set({ flipped: flipped.checked }));
  }

  /** Offer what the server knows. */
  offer(entries: SensorEntry[]): void {
    this.select.replaceChildren(...entries.map((e) => this.option(e)));
  }

  /** Read a calibration file, and choose it. */
  async load(file: Blob, name: string, optics: Optics = "mirror"): Promise<void> {
    try {
      const entry = await api.loadSensor(file, name, optics);
      await keep(entry.id, { blob: file, name, optics });
      this.choose(entry);
      this.store.set({ sensor: entry.id, ...AS_IN_FILE });
      say(`${entry.name} loaded`);
    } catch (e) {
      this.failed(e);
    }
  }

  /** OCamCalib's files do not say what they are of. */
  private async loadAgain(optics: Optics): Promise<void> {
    const file = await kept(this.store.state.sensor);
    if (file) await this.load(file.blob, file.name, optics);
  }

  /** Fetch the camera that the state asks for. */
  async fetch(): Promise<void> {
    const { sensor, looks, forward, flipped } = this.store.state;
    const number = ++this.asked;
    const mount = { camera_looks: looks, forward_azimuth_deg: forward, image_flipped: flipped };
    try {
      const { model, tables } = await api.camera(sensor, mount).catch(async (e: unknown) => {
        const file = await kept(sensor);
        if (!(e instanceof api.Refused) || !file) throw e;
        this.choose(await api.loadSensor(file.blob, file.name, file.optics)); // the server was started anew
        return api.camera(sensor, mount);
      });
      if (number === this.asked) this.take(new Camera(model, tables));
    } catch (e) {
      if (number === this.asked) this.failed(e);
    }
  }

  take(camera: Camera): void {
    this.camera = camera;
    const { model } = camera;
    byId("sensor-words").textContent = `${model.title.replace(/\.$/, "")}. Field ${model.tilt_min_deg.toFixed(0)}° to ${model.tilt_max_deg.toFixed(0)}° of elevation.`;
    this.select.value = model.id;
    if (this.select.value !== model.id) this.choose(model);
    this.showLooks(model.mount.camera_looks);
    byId<HTMLInputElement>("forward").value = String(model.mount.forward_azimuth_deg);
    byId<HTMLInputElement>("flipped").checked = model.mount.image_flipped;
    const [kind, field] = model.id.split(":");
    byId("optics-row").hidden = model.kind !== "ocam" || !model.id.startsWith("file:");
    if (model.kind === "ocam") this.showOptics(model.options.includes("fisheye") ? "fisheye" : "mirror");
    byId("ball-row").hidden = kind !== "ball";
    if (kind === "ball") byId<HTMLInputElement>("ball-field").value = field;
    this.changed();
  }

  private choose(entry: { id: string; name: string; title: string; kind: SensorEntry["kind"] }): void {
    const group = entry.kind === "ball" ? [...this.select.options].find((o) => o.value.startsWith("ball:")) : null;
    if (group) group.replaceWith(this.option(entry));
    else if (![...this.select.options].some((o) => o.value === entry.id)) this.select.append(this.option(entry));
    this.select.value = entry.id;
  }

  private option(entry: { id: string; name: string; title: string }): HTMLOptionElement {
    return Object.assign(document.createElement("option"), { value: entry.id, textContent: entry.name, title: entry.title });
  }
}

type Optics = NonNullable<Kept["optics"]>;

const AS_IN_FILE = { rim: null, looks: null, forward: null, flipped: null } as const;
