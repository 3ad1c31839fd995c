import type { Plugin } from 'vite';
import { pageConfig } from '../vite_page';

// Puts script and style into the page itself: a report is one file that opens anywhere.
const oneFile: Plugin = {
  name: 'one-file',
  enforce: 'post',
  generateBundle(_, bundle) {
    const page = bundle['index.html'];
    if (page?.type !== 'asset') throw new Error('there is no index.html to put the parts into');
    let text = String(page.source).replace(/<script type="module"[^>]*><\/script>|<link rel="stylesheet"[^>]*>/g, '');
    for (const [name, part] of Object.entries(bundle)) {
      if (part === page) continue;
      const [tag, before, inside] = part.type === 'chunk' ? ['script', '</body>', part.code.replaceAll('</script', '<\\/script')] : ['style', '</head>', String(part.source)];
      const element = `<${tag}${tag === 'script' ? ' type="module"' : ''}>${inside}</${tag}>\n`;
      text = text.replace(before, () => element + before);
      delete bundle[name];
    }
    page.source = text;
  },
};

export default pageConfig({ plugins: [oneFile], build: { modulePreload: false, cssCodeSplit: false } });
