/** Whether this browser is signed in, and the way to where it signs in. */

// A socket whose session has ended is closed with it; see app/http/gate/security.py.
export const SESSION_OVER = 4401;

let leaving = false;

/** Leave the page: nothing on it works any more. */
export function toSignIn() {
  // Every socket and request learns of it; each further call would begin the way anew.
  if (leaving) return;
  leaving = true;
  location.replace("/sign-in#signed-out");
}

/** Leave the page if the server is there and does not know this browser (any more). */
export async function leaveIfSignedOut() {
  try {
    // Who is signed in is sent on from there.
    const answer = await fetch("/sign-in", { redirect: "manual", cache: "no-store" });
    if (answer.ok) toSignIn();
  } catch {
    // The server is away, which says nothing of the session.
  }
}
