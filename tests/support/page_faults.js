// Faults of the page as it is laid out now. A box may be wider than the page only inside a box that scrolls.
(() => {
  const width = document.documentElement.clientWidth, found = [];
  const whole = document.documentElement.scrollWidth;
  if (whole > width) found.push(`the page is ${whole} px wide, of ${width}`);
  const scrolls = e => {
    for (; e; e = e.parentElement) if (['auto', 'scroll'].includes(getComputedStyle(e).overflowX)) return true;
    return false;
  };
  for (const e of document.body.querySelectorAll('*')) {
    if (e.closest('svg') && e.tagName !== 'svg') continue;
    const box = e.getBoundingClientRect();
    if (box.width && (box.right > width + 0.5 || box.left < -0.5) && !scrolls(e))
      found.push(`${e.tagName} from ${box.left} to ${box.right} px: ${e.textContent.slice(0, 60)}`);
  }
  for (const svg of document.querySelectorAll('svg')) {
    const own = svg.getBoundingClientRect();
    for (const text of svg.querySelectorAll('text')) {
      const box = text.getBoundingClientRect();
      const scale = text.getScreenCTM();
      // A text may stand upright.
      const size = parseFloat(getComputedStyle(text).fontSize) * Math.hypot(scale.a, scale.b);
      if (own.width && size < 11) found.push(`text of ${size.toFixed(1)} px: ${text.textContent}`);
      const beside = box.left < own.left - 1 || box.right > own.right + 1;
      const beyond = box.top < own.top - 1 || box.bottom > own.bottom + 1;
      if (own.width && (beside || beyond)) found.push(`cut: ${text.textContent}`);
    }
  }
  for (const e of document.querySelectorAll('p, td, th, li, summary, figcaption, h1, h2')) {
    const size = parseFloat(getComputedStyle(e).fontSize);
    if (size < 11) found.push(`text of ${size} px: ${e.textContent.slice(0, 60)}`);
  }
  for (const image of document.images)
    if (!image.complete || !image.naturalWidth) found.push(`broken picture: ${image.src.slice(0, 60)}`);
  return {faults: found, text: document.body.innerText, texts: document.querySelectorAll('svg text').length};
})()
