import type { BenchStart } from "../../shared/messages";
import { parsed } from "../../shared/storage";
import type { Design, Tables } from "./design";
import { designOf, lacking } from "./whole";

const LONGEST = 6000; // maximum length in the address; longer designs are stored only

/** Encode a design for the address; "" if it is too long. */
export function inAddress(design: Design): string {
  const text = JSON.stringify(design);
  return text.length > LONGEST ? "" : text;
}

/** Decode a design of an address, or return an error message. */
export function fromAddress(text: string, parts: BenchStart): Design | string {
  const found = parsed(text);
  if (found === undefined)
    return "The design in the address is invalid: the link is incomplete or was changed.";
  const missing = lacking(found, parts);
  return missing === null
    ? designOf(found as Tables)
    : `The design in the address is invalid: ${missing}.`;
}
