import { isUserError } from "./api";
import { byId } from "./dom";
import { INTERNAL_ERROR } from "./texts";

const ERROR_MS = 30_000;
let fading = 0;

/** Display a temporary message. */
export function say(message: string): void {
  const status = byId("notice");
  status.textContent = message;
  status.classList.add("shown");
  clearTimeout(fading);
  fading = window.setTimeout(() => status.classList.remove("shown"), 4000);
}

/** Subject of a permanent message; one message per subject. */
type Subject =
  "server" | "address" | "image" | "sensor" | "design" | "calibrate" | "page" | "failure";

const upright = new Map<Subject, string>();

/** Display a permanent message until it is closed; null removes it. */
export function banner(message: string | null, about: Subject = "page"): void {
  if (message === (upright.get(about) ?? null)) return;
  if (message === null) upright.delete(about);
  else upright.set(about, message);
  const place = byId("banner");
  place.hidden = !upright.size;
  place.replaceChildren(...[...upright].map(([subject, text]) => line(subject, text)));
}

function line(subject: Subject, text: string): HTMLElement {
  const element = document.createElement("div");
  const onAvailability = Object.assign(document.createElement("button"), {
    type: "button",
    textContent: "×",
  });
  onAvailability.setAttribute("aria-label", "Close");
  onAvailability.addEventListener("click", () => banner(null, subject));
  element.append(
    Object.assign(document.createElement("span"), { textContent: text }),
    onAvailability,
  );
  return element;
}

/** Progress of a long operation: completed fraction, and a function that cancels it. */
interface Progress {
  fraction?: number;
  cancel?: () => void;
}

let cancelBusy: (() => void) | undefined;

/** Display a long operation; null removes it. */
export function busy(message: string | null, { fraction, cancel }: Progress = {}): void {
  const button = byId<HTMLButtonElement>("busy-cancel");
  if (!message && document.activeElement === button) byId("stage").focus();
  byId("busy").hidden = !message;
  byId("busy-text").textContent = message ?? "";
  byId("busy-fraction").hidden = fraction === undefined;
  byId<HTMLProgressElement>("busy-fraction").value = fraction ?? 0;
  button.hidden = !cancel;
  cancelBusy = cancel;
  button.onclick = () => cancelBusy?.();
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
  if (!isUserError(e)) return banner(INTERNAL_ERROR, "failure");
  if (e.name === "ServerUnavailable") return banner(e.message, "server"); // removed when the server is back
  banner(e.message, about);
  setTimeout(() => upright.get(about) === e.message && banner(null, about), ERROR_MS);
}

/** Report an error handled by the caller; unexpected ones are also written to the console. */
export function fail(e: unknown, about: Subject = "image"): void {
  busy(null);
  if (isUserError(e)) report(e, about);
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
