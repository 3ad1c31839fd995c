#include "recon/import/calibration/calibration_tree.hpp"

#include <cpl_error.h>
#include <cpl_minixml.h>
#include <yaml.h>

#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <memory>

namespace fathom::topside {
namespace {

constexpr int kDeepest = 32;                        // levels
constexpr std::uintmax_t kLargestFile = 4'000'000;  // [bytes]; MATLAB's come with every point it has seen
constexpr const char* kWhite = " \t\r\n";

CalibrationTree scalar(std::string_view text) {
  if (const auto number = decimalNumber(text)) return *number;
  return std::string(text);
}

[[noreturn]] void tooDeep(const CalibrationPlace& place) {
  place.fail("is nested too deeply for a calibration");
}

CalibrationTree parseJson(const std::string& text, const CalibrationPlace& place) {
  const auto guard = [&](int depth, CalibrationTree::parse_event_t, CalibrationTree&) {
    if (depth > kDeepest) tooDeep(place);
    return true;
  };
  try {
    return CalibrationTree::parse(text, guard);
  } catch (const CalibrationTree::exception& error) {
    place.fail("cannot be parsed as JSON: " + std::string(error.what()));
  }
}

class YamlReader {
 public:
  YamlReader(std::string_view text, const CalibrationPlace& place) : place_(place) {
    if (yaml_parser_initialize(&parser_) == 0) place_.fail("cannot be parsed: no memory");
    yaml_parser_set_input_string(&parser_, reinterpret_cast<const unsigned char*>(text.data()), text.size());
  }
  ~YamlReader() { yaml_parser_delete(&parser_); }
  YamlReader(const YamlReader&) = delete;
  YamlReader& operator=(const YamlReader&) = delete;

  CalibrationTree read() {
    for (;;) {
      yaml_event_t event;
      if (yaml_parser_parse(&parser_, &event) == 0)
        place_.at("line " + std::to_string(parser_.problem_mark.line + 1))
            .fail("cannot be parsed as YAML: " + std::string(parser_.problem));
      const std::unique_ptr<yaml_event_t, void (*)(yaml_event_t*)> owner(&event, yaml_event_delete);
      if (event.type == YAML_DOCUMENT_END_EVENT || event.type == YAML_STREAM_END_EVENT) return root_;
      take(event);
    }
  }

 private:
  struct Open {
    CalibrationTree value;
    std::optional<std::string> key;  // of a map, whose value comes next
  };

  void take(const yaml_event_t& event) {
    switch (event.type) {
      case YAML_SCALAR_EVENT: {
        const std::string text(reinterpret_cast<const char*>(event.data.scalar.value),
                               event.data.scalar.length);
        if (!open_.empty() && open_.back().value.is_object() && !open_.back().key)
          open_.back().key = text;
        else
          add(event.data.scalar.style == YAML_PLAIN_SCALAR_STYLE ? scalar(text) : CalibrationTree(text));
        return;
      }
      case YAML_SEQUENCE_START_EVENT:
        return begin(CalibrationTree::array());
      case YAML_MAPPING_START_EVENT:
        return begin(CalibrationTree::object());
      case YAML_SEQUENCE_END_EVENT:
      case YAML_MAPPING_END_EVENT: {
        CalibrationTree done = std::move(open_.back().value);
        open_.pop_back();
        return add(std::move(done));
      }
      case YAML_ALIAS_EVENT:
        place_.fail("has YAML references (*); write the values out");
      default:
        return;
    }
  }
  void begin(CalibrationTree value) {
    if (open_.size() == kDeepest) tooDeep(place_);
    if (!open_.empty() && open_.back().value.is_object() && !open_.back().key)
      place_.fail("has a YAML key that is no text");
    open_.push_back({std::move(value), {}});
  }
  void add(CalibrationTree value) {
    if (open_.empty()) {
      root_ = std::move(value);
    } else if (Open& parent = open_.back(); parent.value.is_object()) {
      parent.value[*parent.key] = std::move(value);
      parent.key.reset();
    } else {
      parent.value.push_back(std::move(value));
    }
  }

  const CalibrationPlace& place_;
  yaml_parser_t parser_;
  std::vector<Open> open_;
  CalibrationTree root_;
};

// Text between tags: numbers, or as it is.
CalibrationTree xmlText(std::string_view text) {
  CalibrationTree numbers = CalibrationTree::array();
  for (std::size_t at = text.find_first_not_of(kWhite); at != std::string_view::npos;) {
    const std::size_t end = std::min(text.find_first_of(kWhite, at), text.size());
    const auto number = decimalNumber(text.substr(at, end - at));
    if (!number) return std::string(text);
    numbers.push_back(*number);
    at = text.find_first_not_of(kWhite, end);
  }
  return numbers.size() == 1 ? numbers[0] : numbers;
}

CalibrationTree fromXml(const CPLXMLNode& element, const CalibrationPlace& place, int depth) {
  if (depth > kDeepest) tooDeep(place);
  CalibrationTree below = CalibrationTree::object();
  std::string text;
  for (const CPLXMLNode* node = element.psChild; node != nullptr; node = node->psNext) {
    if (node->eType == CXT_Text) text += std::string(node->pszValue) + " ";
    if (node->eType != CXT_Element) continue;
    CalibrationTree value = fromXml(*node, place, depth + 1);
    if (!below.contains(node->pszValue)) {
      below[node->pszValue] = CalibrationTree::array({std::move(value)});
    } else {
      below[node->pszValue].push_back(std::move(value));
    }
  }
  if (below.empty()) return xmlText(text);
  for (auto& value : below)
    if (value.size() == 1) value = CalibrationTree(std::move(value[0]));
  return below;
}

CalibrationTree parseXml(const std::string& text, const CalibrationPlace& place) {
  const CPLErrorHandlerPusher quiet(CPLQuietErrorHandler);
  const std::unique_ptr<CPLXMLNode, void (*)(CPLXMLNode*)> tree(CPLParseXMLString(text.c_str()),
                                                                CPLDestroyXMLNode);
  if (!tree) place.fail("cannot be parsed as XML: " + std::string(CPLGetLastErrorMsg()));
  for (const CPLXMLNode* node = tree.get(); node != nullptr; node = node->psNext)
    if (node->eType == CXT_Element && node->pszValue[0] != '?') return fromXml(*node, place, 0);
  place.fail("is XML without an element");
}

}  // namespace

std::string readCalibrationText(const std::filesystem::path& file) {
  const CalibrationPlace place{file};
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) place.fail("is no file; give a stereo calibration");
  if (std::filesystem::file_size(file, error) > kLargestFile)
    place.fail("is too large for a stereo calibration");
  std::ifstream in(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!in) place.fail("cannot be read; give a stereo calibration");
  if (text.find('\0') != std::string::npos) place.fail("is no text; give a stereo calibration");
  if (text.starts_with("\xef\xbb\xbf")) text.erase(0, 3);  // byte order mark
  return text;
}

std::optional<double> decimalNumber(std::string_view text) {
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') text.remove_prefix(1);
  double value = 0;
  const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
  if (read.ec != std::errc() || read.ptr != text.data() + text.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

CalibrationTree parseCalibrationTree(const std::string& text, const std::filesystem::path& file) {
  const CalibrationPlace place{file};
  const std::size_t first = text.find_first_not_of(kWhite);
  if (first == std::string::npos) place.fail("is empty");
  if (text[first] == '{' || text[first] == '[') return parseJson(text, place);
  if (text[first] == '<') return parseXml(text, place);
  std::string_view yaml(text);
  if (yaml.starts_with("%YAML")) yaml.remove_prefix(std::min(yaml.find('\n'), yaml.size()));
  return YamlReader(yaml, place).read();
}

}  // namespace fathom::topside
