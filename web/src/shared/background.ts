/** Run a promise without waiting; a failure is reported as an uncaught error, which the page displays. */
export function background(work: Promise<unknown> | void): void {
  work?.catch((e: unknown) => reportError(e));
}
