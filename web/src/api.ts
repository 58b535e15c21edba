import { ask } from "./ask";
import type { CameraModel, Embedded, MountOf, SensorEntry, SensorFile, Start } from "./messages";

const query = (values: Record<string, unknown>): string =>
  new URLSearchParams(Object.entries(values).filter(([, v]) => v !== null && v !== undefined).map(([k, v]) => [k, String(v)])).toString();

export { Away, Refused } from "./ask";

export const start = async (): Promise<Start> => (await ask("api/start")).json();
export const isThere = async (): Promise<boolean> => ask("health").then(() => true, () => false);

export async function camera(id: string, mount: Partial<Record<keyof MountOf, unknown>>): Promise<{ model: CameraModel; tables: Float32Array }> {
  const [model, tables] = await Promise.all([
    ask(`api/camera?${query({ id, ...mount })}`).then((a) => a.json() as Promise<CameraModel>),
    ask(`api/camera/tables?${query({ id, image_flipped: mount.image_flipped })}`).then((a) => a.arrayBuffer()),
  ]);
  return { model, tables: new Float32Array(tables) };
}

export const room = async (id: string): Promise<Blob> => (await ask(`api/room?${query({ id })}`)).blob();
export const picture = async (id: string): Promise<Blob> => (await ask(`api/picture?${query({ id })}`)).blob();

export const convert = async (file: Blob, name: string): Promise<Blob> =>
  (await ask(`api/pictures?${query({ name })}`, { method: "POST", body: file })).blob();

export const loadSensor = async (file: Blob, name: string, optics = "mirror"): Promise<SensorEntry> =>
  (await ask(`api/sensors?${query({ name, optics })}`, { method: "POST", body: file })).json();

export async function sensorFile(wanted: SensorFile): Promise<string> {
  const init = { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(wanted) };
  return (await ask("api/sensor-file", init)).text();
}

/** What a page from disk holds; null in a page of a server. */
export function embedded(): Embedded | null {
  const found = document.getElementById("embedded")?.textContent;
  return found ? (JSON.parse(found) as Embedded) : null;
}

const bytesOf = (base64: string): Uint8Array<ArrayBuffer> => Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));

export const floats = (base64: string): Float32Array => new Float32Array(bytesOf(base64).buffer);

/** What an address holds inside. */
export function blob(address: string): Blob {
  const comma = address.indexOf(",");
  return new Blob([bytesOf(address.slice(comma + 1))], { type: address.slice(5, address.indexOf(";")) });
}
