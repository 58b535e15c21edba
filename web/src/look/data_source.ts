/** Cameras and rendered rooms, from the server or the page itself. */
import * as api from "../shared/api";
import { embeddedData } from "../shared/dom";
import type {
  StandalonePage,
  StandaloneCamera,
  CameraRequest,
  CameraInfo,
  PageStart,
} from "../shared/messages";
import { blob, floats } from "./embedded";
import { upright } from "./geometry/mounts";

/** Data of a page without a server; null if there is a server. */
export const alone = embeddedData<StandalonePage>("alone");

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
  request: CameraRequest,
): Promise<{ model: CameraInfo; tables: Float32Array }> {
  if (!alone) return api.camera(request);
  const camera_ = standaloneCamera(request.id);
  return {
    model: upright(camera_.untilted, camera_.entry.mount, request),
    tables: floats(camera_.tables),
  };
}

export async function room(id: string): Promise<Blob> {
  if (!alone) return api.room(id);
  const { room: address, entry } = standaloneCamera(id);
  if (!address)
    throw new api.RequestRejected(
      `This page contains no image of a room for ${entry.name}; select a sensor, or open an image.`,
    );
  return blob(address);
}

function standaloneCamera(id: string): StandaloneCamera {
  const camera_ = alone!.cameras.find((c) => c.entry.id === id);
  if (!camera_)
    throw new api.RequestRejected(
      `${id.startsWith("file:") ? "A sensor file" : id} requires a server; select one of the sensors of this page.`,
    );
  return camera_;
}
