#pragma once

#include <cctype>
#include <filesystem>
#include <regex>
#include <string>

namespace fathom::topside {

[[nodiscard]] inline bool isDigit(char c) {
  return std::isdigit(static_cast<unsigned char>(c)) != 0;
}

// 2.png comes before 10.png.
[[nodiscard]] bool naturallyBefore(const std::string& a, const std::string& b);

// "frame_007_L" to "7/".
[[nodiscard]] std::string numbersIn(const std::string& text);

// What the wildcards of a shell pattern (* ? [a-z]) stand for in a name that it matches.
class Wildcards {
 public:
  explicit Wildcards(const std::string& pattern);
  // Each with a slash behind it; "" for a name that does not match.
  [[nodiscard]] std::string of(const std::filesystem::path& file) const;

 private:
  std::regex form_;
};

}  // namespace fathom::topside
