import type { BenchStart } from "../../shared/messages";
import { parsed } from "../../shared/storage";
import type { Design, Tables } from "./design";
import { designOf, lacking } from "./whole";

const LONGEST = 6000; // of a design in the address; longer ones are only kept

/** The design as the address holds it; "" where it is too long. */
export function inAddress(design: Design): string {
  const text = JSON.stringify(design);
  return text.length > LONGEST ? "" : text;
}

/** The design of an address, or what it lacks, in a sentence. */
export function fromAddress(text: string, parts: BenchStart): Design | string {
  const found = parsed(text);
  if (found === undefined)
    return "The design in the address is invalid: the link is incomplete or was changed.";
  const missing = lacking(found, parts);
  return missing === null
    ? designOf(found as Tables)
    : `The design in the address is invalid: ${missing}.`;
}
