#pragma once

#include <filesystem>
#include <string>

namespace fathom::web {

// Writes a report as one HTML file that needs nothing else: the page of report/, with `content` in it (JSON;
// report/src/content.ts has its fields). The file appears whole or not at all. Where the page is not built
// (share/fathom/report beside the program's folder), the file shows the JSON as it is.
void writeReportPage(const std::filesystem::path& file, const std::string& content);

}  // namespace fathom::web
