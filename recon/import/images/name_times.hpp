#pragma once

#include <cctype>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <regex>
#include <string>
#include <vector>

#include "recon/import/images/stereo_files.hpp"

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

// Where a file's name holds its time, UTC.
class NameTime {
 public:
  // As strftime writes it, anywhere in the name: %Y %m %d %H %M %S, %s for the ten digits of Unix time, and
  // %f for the digits of a second's fraction; other characters stand for themselves. Throws InputError for
  // a pattern without a date and time.
  explicit NameTime(const std::string& pattern);

  // [ns]; none where the name does not hold a time, or one that does not exist.
  [[nodiscard]] std::optional<std::int64_t> of(const std::string& name) const;

  // Date and time of day with any of the usual separators, and Unix time in seconds to nanoseconds; a
  // fraction has 3, 6 or 9 digits.
  [[nodiscard]] static const std::vector<NameTime>& usual();
  // By the first of these forms that a name holds [ns].
  [[nodiscard]] static std::optional<std::int64_t> usualOf(const std::string& name);

 private:
  NameTime(std::regex form, std::string fields) : form_(std::move(form)), fields_(std::move(fields)) {}

  std::regex form_;
  std::string fields_;  // of its groups, by the letters of the pattern
};

// When a camera says that it took an image: DateTimeOriginal and SubSecTimeOriginal of a JPEG's EXIF, as if
// UTC [ns].
[[nodiscard]] std::optional<std::int64_t> exifTime(const std::filesystem::path& image);

// "3 images are" to "3 images are left out: a.png, b.png, c.png", of many the first few.
[[nodiscard]] std::string leftOut(const std::string& which, const std::vector<std::string>& names);

// Gives all pairs their times, if most have one and these differ: by `pattern` (NameTime), else those that
// they have, else by the usual forms of the left images' names, else as the left images' EXIF says, else
// none. Adds to `assumed` what was taken; pairs that have none where most do are left out. Throws InputError
// for a pattern that does not fit.
void takeTimes(const std::string& pattern, StereoFiles& files);

}  // namespace fathom::topside
