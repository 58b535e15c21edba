import { ask } from "../ask";
import type { BenchSensor, BenchStart, Change, Download, Opened, PictureAsk, Taken, WantedFile } from "./messages";
import { unpack } from "./link";

export { Away, Refused } from "../ask";

const post = (url: string, body: unknown): Promise<Response> =>
  ask(url, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });

export const start = async (): Promise<BenchStart> => (await ask("api/bench")).json();
export const bundled = async (name: string): Promise<BenchSensor> => (await ask(`api/bench/sensor?${new URLSearchParams({ name })}`)).json();
export const change = async (wanted: Change): Promise<BenchSensor> => (await post("api/bench/change", wanted)).json();
export const open = async (file: Blob, name: string): Promise<Opened> =>
  (await ask(`api/bench/open?${new URLSearchParams({ name })}`, { method: "POST", body: file })).json();
export const requirements = async (wanted: WantedFile): Promise<Blob> => (await post("api/bench/requirements", wanted)).blob();

export async function download(wanted: Download): Promise<{ blob: Blob; name: string }> {
  const answer = await post("api/bench/file", wanted);
  const name = /filename="(.*)"/.exec(answer.headers.get("content-disposition") ?? "")?.[1] ?? "design";
  return { blob: await answer.blob(), name };
}

export async function picture(wanted: PictureAsk): Promise<{ picture: Blob; panorama: Blob }> {
  const data = await (await post("api/bench/picture", wanted)).arrayBuffer();
  const { header, start } = unpack<Taken>(data);
  const middle = start + header.picture_bytes;
  const jpeg = (from: number, to: number): Blob => new Blob([data.slice(from, to)], { type: "image/jpeg" });
  return { picture: jpeg(start, middle), panorama: jpeg(middle, middle + header.panorama_bytes) };
}
