import { Away, Refused } from "./api";
import { byId } from "./dom";
import { WENT_WRONG } from "./texts";

let fading = 0;

/** Say something in passing. */
export function say(sentence: string): void {
  const said = byId("said");
  said.textContent = sentence;
  said.classList.add("shown");
  clearTimeout(fading);
  fading = window.setTimeout(() => said.classList.remove("shown"), 4000);
}

/** What a sentence that stays is about; each subject has one at a time. */
type Subject = "server" | "address" | "picture" | "sensor" | "bench" | "calibrate" | "page";

const standing = new Map<Subject, string>();

/** Say something that stays until it is over, or is put away; null when it is over. */
export function banner(sentence: string | null, about: Subject = "page"): void {
  if (sentence === (standing.get(about) ?? null)) return;
  if (sentence === null) standing.delete(about);
  else standing.set(about, sentence);
  const place = byId("banner");
  place.hidden = !standing.size;
  place.replaceChildren(...[...standing].map(([subject, text]) => line(subject, text)));
}

function line(subject: Subject, text: string): HTMLElement {
  const made = document.createElement("div");
  const away = Object.assign(document.createElement("button"), {
    type: "button",
    textContent: "×",
  });
  away.setAttribute("aria-label", "Put this away");
  away.addEventListener("click", () => banner(null, subject));
  made.append(Object.assign(document.createElement("span"), { textContent: text }), away);
  return made;
}

export function busy(sentence: string | null): void {
  byId("busy").hidden = !sentence;
  byId("busy").textContent = sentence ?? "";
}

export async function copy(text: string, what: string, more = ""): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    say(`${what} copied${more}`);
  } catch {
    say(`The browser does not let pages copy; here it is: ${text}`);
  }
}

/** Say what failed; what nobody has foreseen is also thrown, to be found in the console. */
export function fail(e: unknown, about: "picture" | "sensor" = "picture"): void {
  busy(null);
  if (e instanceof Away) banner(e.message, "server");
  else if (e instanceof Refused) banner(e.message, about);
  else {
    banner(WENT_WRONG);
    throw e;
  }
}
