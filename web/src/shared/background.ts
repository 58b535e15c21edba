/** Let work run without waiting for it; its failure is reported as an uncaught error, which the page shows. */
export function background(work: Promise<unknown> | void): void {
  work?.catch((e: unknown) => reportError(e));
}
