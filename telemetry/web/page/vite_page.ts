import { mergeConfig, type UserConfig } from 'vite';

// Relative addresses: a page works from wherever it is served. The output folder comes from CMake (--outDir).
export const pageConfig = (more: UserConfig): UserConfig =>
  mergeConfig({ base: './', build: { target: 'es2022', emptyOutDir: true, chunkSizeWarningLimit: 1700 } }, more);
