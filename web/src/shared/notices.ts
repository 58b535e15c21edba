import { isForeseen } from "./api";
import { byId } from "./dom";
import { WENT_WRONG } from "./texts";

let fading = 0;

/** Display a temporary message. */
export function say(sentence: string): void {
  const said = byId("said");
  said.textContent = sentence;
  said.classList.add("shown");
  clearTimeout(fading);
  fading = window.setTimeout(() => said.classList.remove("shown"), 4000);
}

/** Subject of a permanent message; one message per subject. */
type Subject =
  "server" | "address" | "picture" | "sensor" | "bench" | "calibrate" | "page" | "failure";

const standing = new Map<Subject, string>();

/** Display a permanent message until it is closed; null removes it. */
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

/** Report an error: its message if it is meant for users, otherwise an internal error. */
export function report(e: unknown, about: Subject = "failure"): void {
  if (e instanceof Error && e.name === "AbortError") return; // cancelled by the caller
  if (isForeseen(e)) banner(e.message, e.name === "Away" ? "server" : about);
  else banner(WENT_WRONG, "failure");
}

/** Report an error handled by the caller; unexpected ones are also written to the console. */
export function fail(e: unknown, about: Subject = "picture"): void {
  busy(null);
  if (isForeseen(e)) report(e, about);
  else reportError(e);
}

/** Report unhandled errors and rejected promises. */
export function reportUnhandled(page: EventTarget): void {
  page.addEventListener("error", (e) => {
    const { error } = e as ErrorEvent;
    if (error) report(error); // without an error object it is a browser warning, for example of a ResizeObserver
  });
  page.addEventListener("unhandledrejection", (e) => report((e as PromiseRejectionEvent).reason));
}
