import { byId } from "../../shared/dom";
import type { State } from "../../shared/state";
import type { Store } from "../../shared/store";
import type { Camera } from "../geometry/camera";
import { raised } from "../geometry/lean";
import { panTiltOf, RAD, type Vec3 } from "../geometry/vectors";
import { elevations } from "../geometry/views";
import type { Place } from "../stage";
import type { SensorPanel } from "./sensor";

/** Levelling a sensor that leaned: what is taken hold of in the view goes up and down, to the line of the horizon. */
export class LevelPanel {
  private readonly button = byId<HTMLButtonElement>("level");
  private readonly line = byId("horizon");

  constructor(private readonly store: Store, private readonly sensor: () => SensorPanel, changed: () => void) {
    this.button.addEventListener("click", () => {
      const isOn = !this.isOn;
      this.button.setAttribute("aria-pressed", String(isOn));
      if (isOn && !isLevelled(store.state)) store.set({ mode: "panorama" });
      changed();
    });
    byId("plumb").addEventListener("click", () => void this.sensor().want({ pitch: 0, roll: 0 }));
  }

  get isOn(): boolean {
    return this.button.getAttribute("aria-pressed") === "true";
  }

  /** Whether a drag of the view moves the horizon. */
  isDragged(): boolean {
    return this.isOn && isLevelled(this.store.state);
  }

  /** Take what is seen in one direction to the height of another. */
  drag(from: Vec3, to: Vec3): void {
    const mount = this.sensor().camera?.model.mount;
    if (!mount) return;
    const [{ pan, tilt }, after] = [panTiltOf(from), panTiltOf(to)];
    this.sensor().lean(raised({ pitch: mount.pitch_deg, roll: mount.roll_deg }, pan, after.tilt - tilt));
  }

  /** Show where the horizon belongs, over a view in its place on a canvas. */
  show(camera: Camera | null, canvas: HTMLElement, place: Place): void {
    byId("plumb").hidden = !camera || (camera.model.mount.pitch_deg === 0 && camera.model.mount.roll_deg === 0);
    this.line.hidden = !camera || !this.isDragged();
    if (this.line.hidden || !camera) return;
    const { left, top, width, height, state } = place;
    const share = heightOf(state, camera, width / height);
    this.line.hidden = !(share > 0 && share < 1);
    Object.assign(this.line.style, { top: `${canvas.offsetTop + top + share * height}px`, left: `${canvas.offsetLeft + left}px`, width: `${width}px` });
  }
}

const isLevelled = (s: State): boolean => s.mode === "panorama" || s.mode === "perspective";

/** How far down a view its horizon lies, as a part of its height. */
function heightOf(s: State, camera: Camera, aspect: number): number {
  if (s.mode === "perspective") return 0.5 + (aspect / 2 / Math.tan((s.hfov * RAD) / 2)) * Math.tan(s.tilt * RAD);
  const [low, high] = elevations(s, camera, aspect);
  return high / (high - low);
}
