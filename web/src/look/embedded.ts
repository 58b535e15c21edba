import type { Embedded } from "../shared/messages";

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
