/** Whether this browser is signed in, and going to the sign-in page. */

let leaving = false;

/** Leave for the sign-in page: nothing works here any more. */
export function goToSignIn() {
  // Every socket and request gets here; further calls would restart the navigation.
  if (leaving) return;
  leaving = true;
  location.replace("/sign-in#signed-out");
}

/** Leave the page if the server responds but does not know this browser (any more). */
export async function leaveIfSignedOut() {
  try {
    // A signed-in browser is redirected from there.
    const answer = await fetch("/sign-in", { redirect: "manual", cache: "no-store" });
    if (answer.ok) goToSignIn();
  } catch {
    // The server is away, which says nothing about the session.
  }
}
