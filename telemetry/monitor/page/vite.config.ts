import { defineConfig } from 'vite';

// Relative paths: the page works from any address. The output folder comes from CMake (--outDir).
export default defineConfig({
  base: './',
  build: { target: 'es2022', emptyOutDir: true, chunkSizeWarningLimit: 900 },
  server: { proxy: { '/api': 'http://127.0.0.1:8080' } },
});
