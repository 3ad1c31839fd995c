#pragma once

#include <Eigen/Core>
#include <cmath>
#include <concepts>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace fathom::web {

// Colours that are read on a dark page and on white paper.
inline constexpr const char *kBlue = "#5b9bd5", *kRed = "#f0705c", *kGreen = "#74c08f", *kGrey = "#8c9faa";
// One of a dozen that tell neighbours apart.
[[nodiscard]] const char* distinctColour(std::size_t index);

inline constexpr double kHalfPage = 460, kThirdPage = 340;  // widths of plots that stand side by side [px]

// "1.23 ± 0.04": a value with one standard deviation.
[[nodiscard]] std::string plusMinus(double value, double sigma, int digits);

// Places of a plot, drawn alike. One that is not finite lifts the pen.
struct Series {
  enum class Kind { kLine, kDots, kAreas };  // kAreas: the inside of polygons
  std::string label = {};                    // none: not in the key
  Kind kind = Kind::kLine;
  std::string colour = kBlue;
  std::vector<Eigen::Vector2d> at = {};
  bool dashed = false;
  double size = 0;  // a line's width, a dot's radius [px]; 0: the usual

  void lift();
  void rectangle(const Eigen::Vector2d& one, const Eigen::Vector2d& other);  // of kAreas
};

struct Plot {
  std::string title = {}, x = {}, y = {};  // labels of the axes with their units
  std::vector<Series> series = {};
  double width = 0;                   // [px]; 0: the page's
  bool equal = false;                 // a unit is as long either way, as on a map
  bool down = false;                  // y grows downwards, as in an image
  bool log_x = false, log_y = false;  // logarithmic axes
};

// How many values fall into each of `bins` equal parts of [low, high]; the outermost also hold what lies
// beyond.
[[nodiscard]] Plot histogram(const std::vector<double>& values, double low, double high, int bins,
                             const std::string& label, const std::string& title);

// Of a table: words, a whole number, or another number as words with the digits that count.
struct Cell {
  Cell(std::string words) : text(std::move(words)) {}                // NOLINT(google-explicit-constructor)
  Cell(const char* words) : text(words) {}                           // NOLINT(google-explicit-constructor)
  Cell(std::integral auto number) : text(std::to_string(number)) {}  // NOLINT(google-explicit-constructor)
  Cell(std::string words, double strength) : text(std::move(words)), shade(strength) {}
  std::string text;
  double shade = NAN;  // of the ground, from blue (-1) over none (0) to red (1)
};
using Row = std::vector<Cell>;

// A report as one HTML file that needs nothing else: the page of report/, with the content in it as JSON
// (report/src/content.ts has its fields).
class Report {
 public:
  Report(std::string title, std::string about) : title_(std::move(title)), about_(std::move(about)) {}

  // What is added next stands under this heading. A section without parts is left out.
  void section(const std::string& title) { sections_.push_back({title, {}}); }
  void text(const std::string& words);
  void warning(const std::string& words);
  void list(const std::vector<std::string>& lines);  // no lines: nothing
  void table(const Row& head, const std::vector<Row>& rows);
  void picture(std::string_view png, const std::string& caption);
  void pictureFile(const std::filesystem::path& png, const std::string& caption);
  void plot(const Plot& plot);

  // The file appears whole or not at all. Where the page is not built (share/fathom/report beside the
  // program's folder), the file shows the JSON as it is.
  void write(const std::filesystem::path& file) const;

 private:
  struct Section {
    std::string title;
    std::vector<std::string> parts;  // JSON
  };
  void add(std::string part) { sections_.back().parts.push_back(std::move(part)); }

  std::string title_, about_;
  std::vector<Section> sections_ = {{"", {}}};
};

}  // namespace fathom::web
