/** Cameras and rendered rooms, from the server or the page itself. */
import * as api from "../shared/api";
import { heldBy } from "../shared/dom";
import type {
  StandalonePage,
  StandaloneCamera,
  CameraRequest,
  CameraInfo,
  PageStart,
} from "../shared/messages";
import { blob, floats } from "./embedded";
import { standing } from "./geometry/mounts";

/** Data of a page without a server; null if there is a server. */
export const alone = heldBy<StandalonePage>("alone");

export async function start(): Promise<PageStart> {
  if (!alone) return api.start();
  return {
    version: alone.version,
    sources: [],
    sensors: alone.cameras.map((c) => c.entry),
    source: null,
    sensor: null,
  };
}

export async function camera(
  asked: CameraRequest,
): Promise<{ model: CameraInfo; tables: Float32Array }> {
  if (!alone) return api.camera(asked);
  const found = held(asked.id);
  return {
    model: standing(found.standing, found.entry.mount, asked),
    tables: floats(found.tables),
  };
}

export async function room(id: string): Promise<Blob> {
  if (!alone) return api.room(id);
  const { room: address, entry } = held(id);
  if (!address)
    throw new api.Refused(
      `This page contains no image of a room for ${entry.name}; select a sensor, or open an image.`,
    );
  return blob(address);
}

function held(id: string): StandaloneCamera {
  const found = alone!.cameras.find((c) => c.entry.id === id);
  if (!found)
    throw new api.Refused(
      `${id.startsWith("file:") ? "A sensor file" : id} requires a server; select one of the sensors of this page.`,
    );
  return found;
}
