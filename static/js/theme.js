// Dark, light, or as the reader's system has it. Not a module: it runs before anything is drawn.
(() => {
  const NEXT = { auto: "dark", dark: "light", light: "auto" };
  const show = (theme) => {
    if (theme === "auto") delete document.documentElement.dataset.theme;
    else document.documentElement.dataset.theme = theme;
  };
  let theme = "auto";
  try {
    theme = localStorage.getItem("theme") ?? "auto";
  } catch {
    // without storage the choice lasts as long as the page
  }
  if (!(theme in NEXT)) theme = "auto";
  show(theme);
  addEventListener("DOMContentLoaded", () => {
    const button = document.getElementById("theme");
    if (!button) return;
    const name = () => {
      button.title = `Colours: ${theme}`;
      button.setAttribute("aria-label", `Colours: ${theme}. Change them`);
    };
    name();
    button.addEventListener("click", () => {
      theme = NEXT[theme];
      show(theme);
      name();
      try {
        localStorage.setItem("theme", theme);
      } catch {
        // as above
      }
    });
  });
})();
