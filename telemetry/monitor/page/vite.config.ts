import { pageConfig } from '../vite_page';

export default pageConfig({ server: { proxy: { '/api': 'http://127.0.0.1:8080' } } });
