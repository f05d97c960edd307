// The token goes to the server once, by POST; a cookie that scripts cannot read stands for it afterwards.

const form = /** @type {HTMLFormElement} */ (document.getElementById("login"));
const field = /** @type {HTMLInputElement} */ (document.getElementById("token"));
const says = /** @type {HTMLElement} */ (document.getElementById("login-says"));

/** @param {string} token */
async function enter(token) {
  says.textContent = "";
  try {
    const answer = await fetch("/login", {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify({ token }),
    });
    if (answer.ok) location.replace("/");
    else says.textContent = (await answer.text()) || "That is not the token.";
  } catch {
    says.textContent = "quavelet does not answer: is it still running?";
  }
  field.focus();
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  enter(field.value.trim());
});

/** The token that the program printed, behind the address; it does not stay there, nor in the history. */
function take() {
  const given = new URLSearchParams(location.hash.slice(1)).get("token");
  if (!given) return field.focus();
  history.replaceState(null, "", location.pathname);
  return enter(given);
}

addEventListener("hashchange", take);
take();
