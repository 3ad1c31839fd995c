#include "recon/import/csv_columns.hpp"

#include <gdal_priv.h>
#include <ogrsf_frmts.h>

#include <strings.h>

#include <cctype>
#include <charconv>
#include <cmath>
#include <memory>
#include <regex>

#include "realtime/base/input_error.hpp"
#include "realtime/base/units.hpp"
#include "recon/import/images/name_times.hpp"

namespace fathom::topside {

CsvColumns::CsvColumns(const std::filesystem::path& path) : path_(path) {
  if (!std::filesystem::is_regular_file(path)) throw InputError(path.string(), "", "is not there");
  GDALAllRegister();
  const char* const drivers[] = {"CSV", nullptr};
  const char* const options[] = {"HEADERS=YES", "AUTODETECT_TYPE=NO", nullptr};
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  const std::unique_ptr<GDALDataset> set(GDALDataset::Open(
      ("CSV:" + path.string()).c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY, drivers, options));
  OGRLayer* layer = set && set->GetLayerCount() == 1 ? set->GetLayer(0) : nullptr;
  if (layer == nullptr)
    throw InputError(path.string(), "",
                     "is no table of comma-separated values; give one with a line of column names");
  OGRFeatureDefn* columns = layer->GetLayerDefn();
  for (int k = 0; k < columns->GetFieldCount(); ++k)
    names_.emplace_back(columns->GetFieldDefn(k)->GetNameRef());
  for (const auto& feature : *layer) {
    std::vector<std::string>& row = rows_.emplace_back();
    for (int k = 0; k < columns->GetFieldCount(); ++k) row.emplace_back(feature->GetFieldAsString(k));
  }
}

std::optional<std::size_t> CsvColumns::column(const std::string& name) const {
  for (std::size_t k = 0; k < names_.size(); ++k)
    if (::strcasecmp(names_[k].c_str(), name.c_str()) == 0) return k;
  return std::nullopt;
}

std::size_t CsvColumns::required(const std::string& name) const {
  if (const auto found = column(name)) return *found;
  std::string list;
  for (const std::string& known : names_) list += (list.empty() ? "" : ", ") + known;
  throw InputError(path_.string(), "line 1", "has no column '" + name + "'; there are: " + list);
}

std::optional<double> CsvColumns::number(std::size_t row, std::size_t column) const {
  std::string text = rows_[row][column];
  std::erase_if(text, [](unsigned char c) { return std::isspace(c) != 0; });
  if (text.empty()) return {};
  double value = 0;
  const char* begin = text.data() + (text.front() == '+' ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size())
    fail(row, "has '" + text + "' in column " + names_[column] + ", which is no number");
  if (!std::isfinite(value)) return {};
  return value;
}

std::int64_t CsvColumns::time(std::size_t row, std::size_t column, double unit) const {
  const auto value = number(row, column);
  constexpr double kMost = 9e18;  // [ns]
  if (!value || !(std::abs(*value * unit) < kMost)) fail(row, "has no time '" + text(row, column) + "'");
  // Whole units apart from their fraction: a double has not the digits of both.
  const double whole = std::floor(*value);
  return static_cast<std::int64_t>(whole) * static_cast<std::int64_t>(unit) +
         std::llround((*value - whole) * unit);
}

std::int64_t CsvColumns::time(std::size_t row, std::size_t column) const {
  if (const auto time = timeOf(text(row, column))) return *time;
  try {
    return time(row, column, kNanosecondsPerSecond);
  } catch (const InputError&) {
    fail(row, "has no time '" + text(row, column) + "'; give 2024-02-17T05:15:49.768, Unix time or seconds");
  }
}

std::optional<std::int64_t> CsvColumns::timeOf(const std::string& text) {
  static const std::regex kOffset(R"(\d{2}:\d{2}:\d{2}(?:[.,]\d+)?\s*([+-])(\d{2}):?(\d{2})?$)");
  std::smatch found;
  std::int64_t ahead = 0;
  if (std::regex_search(text, found, kOffset)) {
    constexpr std::int64_t kMinute = 60'000'000'000;  // [ns]
    const std::string minutes = found[3].str();
    ahead = (found[1] == "-" ? -1 : 1) * kMinute *
            (60 * std::stoll(found[2].str()) + (minutes.empty() ? 0 : std::stoll(minutes)));
  }
  const auto time = NameTime::usualOf(text);
  return time ? std::optional(*time - ahead) : std::nullopt;
}

void CsvColumns::fail(std::size_t row, const std::string& what) const {
  throw InputError(path_.string(), "row " + std::to_string(row + 1), what);
}

}  // namespace fathom::topside
