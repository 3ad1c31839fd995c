import { cpSync } from 'node:fs';
import { join } from 'node:path';
import { defineConfig, type Plugin } from 'vite';

// The decoders that three loads at run time lie beside the page: nothing comes from the network.
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

// Relative paths: the page works from any address. The output folder comes from CMake (--outDir).
export default defineConfig({
  base: './',
  plugins: [decoders()],
  worker: { format: 'es' },
  build: { target: 'es2022', emptyOutDir: true, chunkSizeWarningLimit: 1600 },
});
