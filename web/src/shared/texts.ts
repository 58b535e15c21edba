/** Messages about the page and its server that are used in several places. */

const RELOAD = "reload the page.";

export const NO_RESPONSE = "The server of the studio does not respond.";
export const SERVER_UNAVAILABLE = `${NO_RESPONSE} The page resumes when the connection is restored.`;
export const loadFailed = (part: string): string =>
  `${part} could not be loaded from the server; ${RELOAD}`;
export const INTERNAL_ERROR = `An internal error occurred in this page; ${RELOAD}`;
