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

// Colours that can be read on a dark page and on white paper.
inline constexpr const char *kBlue = "#5b9bd5", *kRed = "#f0705c", *kGreen = "#74c08f", *kGrey = "#8c9faa";
// One of twelve colours that differ between neighbours.
[[nodiscard]] const char* distinctColour(std::size_t index);

inline constexpr double kHalfPage = 460, kThirdPage = 340;  // widths of plots that stand side by side [px]

// "1.23 ± 0.04": a value with one standard deviation.
[[nodiscard]] std::string plusMinus(double value, double sigma, int digits);

// Points of a plot, drawn alike. A point that is not finite interrupts a line.
struct Series {
  enum class Kind { kLine, kDots, kAreas };  // kAreas: the inside of polygons
  std::string label = {};                    // empty: not in the legend
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
  bool equal = false;                 // units have the same length on both axes, as on a map
  bool down = false;                  // y grows downwards, as in an image
  bool log_x = false, log_y = false;  // logarithmic axes
};

// Counts of values in `bins` equal parts of [low, high]; the outermost include the values beyond.
[[nodiscard]] Plot histogram(const std::vector<double>& values, double low, double high, int bins,
                             const std::string& label, const std::string& title);

// A cell of a table: words, a whole number, or another number formatted with its digits.
struct Cell {
  Cell(std::string words) : text(std::move(words)) {}                // NOLINT(google-explicit-constructor)
  Cell(const char* words) : text(words) {}                           // NOLINT(google-explicit-constructor)
  Cell(std::integral auto number) : text(std::to_string(number)) {}  // NOLINT(google-explicit-constructor)
  Cell(std::string words, double strength) : text(std::move(words)), shade(strength) {}
  std::string text;
  double shade = NAN;  // background, from blue (-1) over none (0) to red (1)
};
using Row = std::vector<Cell>;

// A report as one HTML file that needs nothing else: the page of report/, with the content in it as JSON
// (report/src/content.ts has its fields).
class ReportPage {
 public:
  ReportPage(std::string title, std::string about) : title_(std::move(title)), about_(std::move(about)) {}

  // Starts a section: what is added next belongs to it. A section without parts is left out.
  void section(const std::string& title) { sections_.push_back({title, {}}); }
  void text(const std::string& words);
  void warning(const std::string& words);
  void list(const std::vector<std::string>& lines);  // no lines: nothing
  void table(const Row& head, const std::vector<Row>& rows);
  void picture(std::string_view png, const std::string& caption);
  void pictureFile(const std::filesystem::path& png, const std::string& caption);
  void plot(const Plot& plot);

  // Writes the file, whole or not at all. When the page is not built (share/fathom/report beside the
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
