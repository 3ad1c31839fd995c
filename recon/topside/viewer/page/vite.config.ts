import { cpSync } from 'node:fs';
import { join } from 'node:path';
import type { Plugin } from 'vite';
import { pageConfig } from '../vite_page';

// The decoders that three loads at run time are beside the page: nothing comes from the network.
function decoders(): Plugin {
  let out = '';
  return {
    name: 'decoders',
    apply: 'build',
    configResolved: (config) => { out = config.build.outDir; },
    closeBundle: () => {
      const libraries = 'node_modules/three/examples/jsm/libs';
      for (const file of ['draco_decoder.js', 'draco_decoder.wasm', 'draco_wasm_wrapper.js']) cpSync(join(libraries, 'draco/gltf', file), join(out, 'draco', file));
      for (const file of ['basis_transcoder.js', 'basis_transcoder.wasm']) cpSync(join(libraries, 'basis', file), join(out, 'basis', file));
    },
  };
}

export default pageConfig({ plugins: [decoders()], worker: { format: 'es' } });
