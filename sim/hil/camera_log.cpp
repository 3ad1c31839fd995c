#include "sim/hil/camera_log.hpp"

#include <algorithm>
#include <charconv>
#include <fstream>
#include <string_view>

#include "realtime/kernel/input_error.hpp"

namespace fathom::sim {
namespace {

std::vector<std::string_view> split(std::string_view line) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t comma = line.find(',');
    fields.push_back(line.substr(0, comma));
    if (comma == std::string_view::npos) return fields;
    line.remove_prefix(comma + 1);
  }
}

template <class Number>
bool parse(std::string_view text, Number& out) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out);
  return error == std::errc() && end == text.data() + text.size();
}

}  // namespace

std::vector<CameraLogRow> readCameraLog(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string line;
  if (!file || !std::getline(file, line))
    throw InputError(path.string(), "", "is no log of a simulated camera");
  const std::string header = line;
  const std::vector<std::string_view> names = split(header);
  const auto column = [&](std::string_view name) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end())
      throw InputError(path.string(), "line 1",
                       "has no column " + std::string(name) + "; give a camera's --log");
    return static_cast<std::size_t>(found - names.begin());
  };
  const std::size_t mission = column("mission_s"), image = column("file"), id = column("frame_id"),
                    exposed = column("exposed_utc_ns"), fate = column("fate"), lost = column("packets_lost");
  std::vector<CameraLogRow> rows;
  while (std::getline(file, line)) {
    const std::vector<std::string_view> fields = split(line);
    if (fields.size() != names.size()) continue;
    CameraLogRow row;
    row.file = fields[image];
    row.fate = fields[fate];
    if (parse(fields[mission], row.mission_s) && parse(fields[id], row.frame_id) &&
        parse(fields[exposed], row.exposed_utc_ns) && parse(fields[lost], row.packets_lost))
      rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace fathom::sim
