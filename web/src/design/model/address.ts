import type { DesignStart } from "../../shared/messages";
import { parsed } from "../../shared/storage";
import type { Design, Tables } from "./design";
import { designOf, lacking } from "./validation";

const MAX_LENGTH = 6000; // maximum length in the address; longer designs are stored only

/** Encode a design for the address; "" if it is too long. */
export function inAddress(design: Design): string {
  const text = JSON.stringify(design);
  return text.length > MAX_LENGTH ? "" : text;
}

/** Decode a design of an address, or return an error message. */
export function fromAddress(text: string, parts: DesignStart): Design | string {
  const result = parsed(text);
  if (result === undefined)
    return "The design in the address is invalid: the link is incomplete or was changed.";
  const missing = lacking(result, parts);
  return missing === null
    ? designOf(result as Tables)
    : `The design in the address is invalid: ${missing}.`;
}
