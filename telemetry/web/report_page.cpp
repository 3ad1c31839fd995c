#include "telemetry/web/report_page.hpp"

#include <fstream>
#include <iterator>
#include <string_view>

#include "recon/geometry/atomic_file.hpp"
#include "telemetry/web/page_server.hpp"

namespace fathom::web {
namespace {

constexpr std::string_view kPlace = "FATHOM_CONTENT";  // where in the page the content goes

std::string readPage() {
  std::ifstream in(builtPage("report") / "index.html", std::ios::binary);
  const std::string page{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  return page.find(kPlace) != std::string::npos
             ? page
             : "<!doctype html><meta charset=\"utf-8\"><pre>" + std::string(kPlace) + "</pre>\n";
}

// As it may stand inside an element: in JSON, < occurs in strings alone.
std::string insideElement(const std::string& json) {
  std::string out;
  out.reserve(json.size());
  for (const char c : json)
    if (c == '<')
      out += "\\u003c";
    else
      out += c;
  return out;
}

}  // namespace

void writeReportPage(const std::filesystem::path& file, const std::string& content) {
  const std::string page = readPage();
  const std::size_t place = page.find(kPlace);
  AtomicFile out(file);
  out.stream() << std::string_view(page).substr(0, place) << insideElement(content)
               << std::string_view(page).substr(place + kPlace.size());
  out.commit();
}

}  // namespace fathom::web
