import { isForeseen } from "./api";
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
type Subject =
  "server" | "address" | "picture" | "sensor" | "bench" | "calibrate" | "page" | "failure";

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
  away.setAttribute("aria-label", "Close");
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
    say(`The browser does not permit copying. Copy manually: ${text}`);
  }
}

/** Report a failure: the sentence of one that was foreseen, or else that something went wrong. */
export function report(e: unknown, about: Subject = "failure"): void {
  if (e instanceof Error && e.name === "AbortError") return; // cancelled by whoever started it
  if (isForeseen(e)) banner(e.message, e.name === "Away" ? "server" : about);
  else banner(WENT_WRONG, "failure");
}

/** Report a failure that its caller handles; an unforeseen one is also left to the console. */
export function fail(e: unknown, about: Subject = "picture"): void {
  busy(null);
  if (isForeseen(e)) report(e, about);
  else reportError(e);
}

/** Report errors and rejected promises that nothing handles, for as long as the page lives. */
export function reportUnhandled(page: EventTarget): void {
  page.addEventListener("error", (e) => {
    const { error } = e as ErrorEvent;
    if (error) report(error); // without one it is a warning of the browser's, as of a ResizeObserver
  });
  page.addEventListener("unhandledrejection", (e) => report((e as PromiseRejectionEvent).reason));
}
