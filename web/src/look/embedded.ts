import { embeddedData } from "../shared/dom";
import type { EmbeddedImage } from "../shared/messages";

/** Return the embedded data of a page with one image; null in other pages. */
export const embedded = (): EmbeddedImage | null => embeddedData("embedded");

const bytesOf = (base64: string): Uint8Array<ArrayBuffer> =>
  Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));

export const floats = (base64: string): Float32Array => new Float32Array(bytesOf(base64).buffer);

/** Return the content of a data URL. */
export function blob(address: string): Blob {
  const comma = address.indexOf(",");
  return new Blob([bytesOf(address.slice(comma + 1))], {
    type: address.slice(5, address.indexOf(";")),
  });
}
