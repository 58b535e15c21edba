/** Messages about the page and its server that are used in several places. */

const ANEW = "reload the page.";

export const NO_ANSWER = "The server of the studio does not respond.";
export const AWAY = `${NO_ANSWER} The page resumes when the connection is restored.`;
export const unfetched = (part: string): string =>
  `${part} could not be loaded from the server; ${ANEW}`;
export const WENT_WRONG = `An internal error occurred in this page; ${ANEW}`;
