#pragma once

#include <cstdint>
#include <optional>
#include <regex>
#include <string>
#include <vector>

namespace fathom::topside {

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

}  // namespace fathom::topside
