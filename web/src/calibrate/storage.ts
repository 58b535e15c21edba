/**
 * Browser storage of the tab. Small data are stored synchronously, so that a reload never loses them. Images,
 * detections and the camera are stored asynchronously, under the keys of the image list.
 */
import type { BoardDetection, CalibrationResult } from "../shared/messages";
import {
  locals,
  parsed,
  put,
  sessions,
  storeValue,
  storedValue,
  load,
  deleteValue,
} from "../shared/storage";

/** Image with its storage key. */
export interface Listed {
  key: string;
  name: string;
  /** Time of a video frame, s. */
  time: number | null;
}

/** Camera with the images of its calibration. */
interface Result {
  of: string[];
  result: CalibrationResult;
  report: string | null;
}

const SETTINGS = "omnimirror-calibrate";
const LIST = "omnimirror-boards";
const PARTS = ["", " seen", " result"] as const;
const name = (key: string, part: (typeof PARTS)[number]): string => `board ${key}${part}`;

/** Return the stored state of this tab, or of the last one. */
function storedJson(key: string): unknown {
  return parsed(load(sessions, key) ?? load(locals, key) ?? "null");
}

export function storedSettings<T extends object>(): Partial<T> | null {
  const settings = storedJson(SETTINGS);
  return settings && typeof settings === "object" ? settings : null;
}

export const storeSettings = (settings: object): void =>
  put([sessions, locals], SETTINGS, JSON.stringify(settings));

export function storedList(): Listed[] {
  const list = storedJson(LIST);
  const isListed = (l: Partial<Listed> | null): boolean =>
    typeof l?.key === "string" &&
    typeof l.name === "string" &&
    (l.time === null || typeof l.time === "number");
  return Array.isArray(list) ? (list as Listed[]).filter(isListed) : [];
}

export const storeList = (list: Listed[]): void =>
  put(
    [sessions, locals],
    LIST,
    JSON.stringify(list.map(({ key, name, time }) => ({ key, name, time }))),
  );

export const storedImage = (key: string): Promise<Blob | undefined> => storedValue(name(key, ""));
export const storeImage = (key: string, image: Blob): Promise<unknown> =>
  storeValue(name(key, ""), image);
export const storedDetection = (key: string): Promise<BoardDetection | undefined> =>
  storedValue(name(key, " seen"));
export const storeDetection = (key: string, detection: BoardDetection): Promise<unknown> =>
  storeValue(name(key, " seen"), detection);

/** Return the camera of exactly these images, stored with the first of them. */
export async function storedResult(keys: string[]): Promise<Result | null> {
  const result = keys.length ? await storedValue<Result>(name(keys[0], " result")) : undefined;
  return result && JSON.stringify(result.of) === JSON.stringify(keys) ? result : null;
}

export async function storeResult(
  keys: string[],
  camera: CalibrationResult | null,
  report: string | null,
): Promise<void> {
  if (keys.length)
    await (camera
      ? storeValue(name(keys[0], " result"), { of: keys, result: camera, report } satisfies Result)
      : deleteValue(name(keys[0], " result")));
}

/** Remove an image and its associated data. */
export async function forget(key: string): Promise<void> {
  await Promise.all(PARTS.map((part) => deleteValue(name(key, part))));
}
