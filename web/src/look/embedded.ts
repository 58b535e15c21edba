import { heldBy } from "../shared/dom";
import type { Embedded } from "../shared/messages";

/** What a page of one picture holds; null in any other. */
export const embedded = (): Embedded | null => heldBy("embedded");

const bytesOf = (base64: string): Uint8Array<ArrayBuffer> =>
  Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));

export const floats = (base64: string): Float32Array => new Float32Array(bytesOf(base64).buffer);

/** What an address holds inside. */
export function blob(address: string): Blob {
  const comma = address.indexOf(",");
  return new Blob([bytesOf(address.slice(comma + 1))], {
    type: address.slice(5, address.indexOf(";")),
  });
}
