#include "telemetry/web/report_page.hpp"

#include <sodium.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "realtime/base/files/atomic_file.hpp"
#include "realtime/base/text.hpp"
#include "telemetry/web/page_server.hpp"

namespace fathom::web {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kPlace = "FATHOM_CONTENT";  // where in the page the content goes

std::string contentsOf(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

std::string readPage() {
  const std::string page = contentsOf(builtPage("report") / "index.html");
  return page.find(kPlace) != std::string::npos
             ? page
             : "<!doctype html><meta charset=\"utf-8\"><pre>" + std::string(kPlace) + "</pre>\n";
}

std::string dumped(const Json& json) {
  return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

// JSON escaped for an HTML element: in JSON, < occurs in strings alone.
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

// Seven digits, which a drawing can show; null for numbers that are not finite.
Json brief(double value) {
  return std::isfinite(value) ? Json(std::strtod(formatted("%.7g", value).c_str(), nullptr)) : Json(nullptr);
}

Json toJson(const Row& row) {
  Json out = Json::array();
  for (const Cell& cell : row)
    out.push_back(std::isfinite(cell.shade) ? Json{{"text", cell.text}, {"shade", cell.shade}}
                                            : Json(cell.text));
  return out;
}

Json toJson(const Series& series) {
  constexpr std::array kKinds{"line", "dots", "areas"};
  Json x = Json::array(), y = Json::array();
  for (const Eigen::Vector2d& place : series.at) {
    x.push_back(brief(place.x()));
    y.push_back(brief(place.y()));
  }
  Json out{{"label", series.label},
           {"kind", kKinds[static_cast<std::size_t>(series.kind)]},
           {"colour", series.colour},
           {"x", std::move(x)},
           {"y", std::move(y)}};
  if (series.dashed) out["dashed"] = true;
  if (series.size > 0) out["size"] = series.size;
  return out;
}

}  // namespace

const char* distinctColour(std::size_t index) {
  static constexpr std::array kColours{"#5b9bd5", "#f0705c", "#74c08f", "#b08fd8", "#f0a04b", "#3fc1d0",
                                       "#b5846f", "#e58fc8", "#9aa5ad", "#c9c04a", "#3f78a8", "#a8663f"};
  return kColours[index % kColours.size()];
}

std::string plusMinus(double value, double sigma, int digits) {
  return decimals(value, digits) + " ± " + decimals(sigma, digits);
}

void Series::lift() {
  at.emplace_back(NAN, NAN);
}

void Series::rectangle(const Eigen::Vector2d& one, const Eigen::Vector2d& other) {
  at.insert(at.end(), {one, {other.x(), one.y()}, other, {one.x(), other.y()}});
  lift();
}

Plot histogram(const std::vector<double>& values, double low, double high, int bins, const std::string& label,
               const std::string& title) {
  std::vector<double> counts(static_cast<std::size_t>(bins), 0.0);
  for (const double v : values) {
    const int bin = static_cast<int>(std::floor((std::clamp(v, low, high) - low) / (high - low) * bins));
    ++counts[static_cast<std::size_t>(std::clamp(bin, 0, bins - 1))];
  }
  constexpr double kBar = 0.92;  // of a part
  Series bars{.kind = Series::Kind::kAreas};
  const double step = (high - low) / bins;
  for (int b = 0; b < bins; ++b)
    bars.rectangle({low + b * step, 0}, {low + (b + kBar) * step, counts[static_cast<std::size_t>(b)]});
  return {.title = title, .x = label, .y = "count", .series = {std::move(bars)}, .width = kHalfPage};
}

void ReportPage::text(const std::string& words) {
  add(dumped({{"text", words}}));
}

void ReportPage::warning(const std::string& words) {
  add(dumped({{"text", words}, {"strong", true}}));
}

void ReportPage::list(const std::vector<std::string>& lines) {
  if (!lines.empty()) add(dumped({{"list", lines}}));
}

void ReportPage::table(const Row& head, const std::vector<Row>& rows) {
  Json lines = Json::array();
  for (const Row& row : rows) lines.push_back(toJson(row));
  add(dumped({{"table", {{"head", toJson(head)}, {"rows", std::move(lines)}}}}));
}

void ReportPage::picture(std::string_view png, const std::string& caption) {
  std::string base64(sodium_base64_ENCODED_LEN(png.size(), sodium_base64_VARIANT_ORIGINAL), '\0');
  sodium_bin2base64(base64.data(), base64.size(), reinterpret_cast<const unsigned char*>(png.data()),
                    png.size(), sodium_base64_VARIANT_ORIGINAL);
  base64.pop_back();  // the terminating zero
  add(dumped({{"picture", {{"source", "data:image/png;base64," + base64}, {"caption", caption}}}}));
}

void ReportPage::pictureFile(const std::filesystem::path& png, const std::string& caption) {
  picture(std::string_view(contentsOf(png)), caption);
}

void ReportPage::plot(const Plot& plot) {
  Json series = Json::array();
  for (const Series& s : plot.series) series.push_back(toJson(s));
  Json out{{"title", plot.title}, {"x", plot.x}, {"y", plot.y}, {"series", std::move(series)}};
  if (plot.width > 0) out["width"] = plot.width;
  if (plot.equal) out["equal"] = true;
  if (plot.down) out["down"] = true;
  if (plot.log_x) out["logX"] = true;
  if (plot.log_y) out["logY"] = true;
  add(dumped({{"plot", std::move(out)}}));
}

void ReportPage::write(const std::filesystem::path& file) const {
  std::string content =
      R"({"title":)" + dumped(title_) + R"(,"about":)" + dumped(about_) + R"(,"sections":[)";
  bool first = true;
  for (const auto& [title, parts] : sections_) {
    if (parts.empty()) continue;
    content += (first ? "" : ",") + (R"({"title":)" + dumped(title)) + R"(,"parts":[)";
    for (std::size_t k = 0; k < parts.size(); ++k) content += (k == 0 ? "" : ",") + parts[k];
    content += "]}";
    first = false;
  }
  std::string page = readPage();
  page.replace(page.find(kPlace), kPlace.size(), insideElement(content + "]}"));
  writeFile(file, page);
}

}  // namespace fathom::web
