/** Browser storage for reloads: the last images, and loaded calibration files. */
import { storeValue, storedValue, deleteValue } from "../../shared/storage";

export interface Stored {
  blob: Blob;
  name: string;
  optics?: "mirror" | "fisheye";
  /** Whether the page created it, so that no file of the user contains it. */
  isMade?: boolean;
}

/** Image or video, identified by its content, and its file name. */
interface Identity {
  id: string;
  name: string;
}

const IMAGES = "images";
const MAX_IMAGES = 8;
const MAX_BYTES = 1 << 29; // maximum total size of all images except the last
const WHOLE_BYTES = 1 << 26; // longer files are identified by their length and samples
const PIECES = 16;
const PIECE_BYTES = 1 << 20;

export const keep = (key: string, value: Stored): Promise<unknown> => storeValue(key, value);
export const stored = (key: string): Promise<Stored | undefined> => storedValue<Stored>(key);

/** Store an image under its identity; the oldest ones are removed. */
export async function storeImage({ id }: Identity, value: Stored): Promise<void> {
  type Listed = { id: string; bytes: number };
  const before = ((await storedValue<Listed[]>(IMAGES)) ?? []).filter((p) => p.id !== id);
  const all = [...before, { id, bytes: value.blob.size }];
  const newest = all
    .slice(-MAX_IMAGES)
    .filter(
      (_, i, some) =>
        i === some.length - 1 || some.slice(i).reduce((sum, q) => sum + q.bytes, 0) < MAX_BYTES,
    );
  for (const gone of all.filter((p) => !newest.includes(p))) await deleteValue(`image ${gone.id}`);
  await storeValue(IMAGES, newest);
  await keep(`image ${id}`, value);
}

export const storedImage = ({ id }: Identity): Promise<Stored | undefined> => stored(`image ${id}`);

/** Return the identity of a file: 64-bit hash of its bytes. */
export async function identityOf(blob: Blob, name: string): Promise<Identity> {
  const step = blob.size / PIECES;
  const pieces = Array.from({ length: PIECES }, (_, i) =>
    blob.slice(Math.floor(i * step), Math.floor(i * step) + PIECE_BYTES),
  );
  const [low, high] = await summed(
    blob.size <= WHOLE_BYTES ? blob : new Blob([...pieces, String(blob.size)]),
  );
  return { id: [low, high].map((word) => word.toString(16).padStart(8, "0")).join(""), name };
}

/** Compute two hashes like FNV with different multipliers. */
async function summed(blob: Blob): Promise<[number, number]> {
  let [low, high] = [0xdeadbeef, 0x41c6ce57];
  for (let from = 0; from < blob.size; from += PIECE_BYTES) {
    const bytes = new Uint8Array(await blob.slice(from, from + PIECE_BYTES).arrayBuffer());
    for (const byte of bytes) {
      low = Math.imul(low ^ byte, 2654435761);
      high = Math.imul(high ^ byte, 1597334677);
      low ^= low >>> 15;
      high ^= high >>> 13;
    }
  }
  return [low >>> 0, high >>> 0];
}

/** Return the source name of a stored image. */
export const sourceOf = ({ id, name }: Identity): string => `kept:${id}:${name}`;

/** Return the identity in a source name; null for other sources. */
export function identityIn(source: string): Identity | null {
  const result = /^kept(?::([0-9a-f]{16}):(.*))?$/s.exec(source);
  return result && { id: result[1] ?? "", name: result[2] ?? "" };
}
