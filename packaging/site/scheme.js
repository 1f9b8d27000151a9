// The pages of the APIs are dark if the site's switch says so, or else if the system does.
(() => {
  const key = Object.keys(localStorage).find(name => name.endsWith('.__palette'));
  const chosen = key && JSON.parse(localStorage[key]).color?.scheme;
  const dark = chosen ? chosen === 'slate' : matchMedia('(prefers-color-scheme: dark)').matches;
  document.documentElement.dataset.scheme = dark ? 'dark' : 'light';
})();
