#include "recon/import/images/name_patterns.hpp"

#include <algorithm>
#include <string_view>

namespace fathom::topside {

bool naturallyBefore(const std::string& a, const std::string& b) {
  std::size_t i = 0, k = 0;
  while (i < a.size() && k < b.size()) {
    if (isDigit(a[i]) && isDigit(b[k])) {
      const auto number = [](const std::string& text, std::size_t& at) {
        while (at < text.size() && text[at] == '0') ++at;
        const std::size_t from = at;
        while (at < text.size() && isDigit(text[at])) ++at;
        return text.substr(from, at - from);
      };
      const std::string x = number(a, i), y = number(b, k);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else if (a[i] != b[k]) {
      return a[i] < b[k];
    } else {
      ++i, ++k;
    }
  }
  return a.size() - i != b.size() - k ? a.size() - i < b.size() - k : a < b;
}

std::string numbersIn(const std::string& text) {
  std::string out;
  for (std::size_t k = 0; k < text.size(); ++k) {
    if (!isDigit(text[k])) continue;
    const std::size_t end = std::min(text.find_first_not_of("0123456789", k), text.size()),
                      from = std::min(text.find_first_not_of('0', k), end - 1);
    out += text.substr(from, end - from) + "/";
    k = end;
  }
  return out;
}

Wildcards::Wildcards(const std::string& pattern) {
  std::string form;
  for (std::size_t k = 0; k < pattern.size(); ++k) {
    const char c = pattern[k];
    const std::size_t close = c == '[' ? pattern.find(']', k + 2) : std::string::npos;
    if (c == '*' || c == '?') {
      form += c == '*' ? "([^/]*)" : "([^/])";
    } else if (close != std::string::npos) {
      std::string set = pattern.substr(k + 1, close - k - 1);
      if (set.front() == '!') set.front() = '^';
      form += "([" + set + "])";
      k = close;
    } else {
      const char literal = c == '\\' && k + 1 < pattern.size() ? pattern[++k] : c;
      if (std::string_view(R"(\^$.|?*+()[]{})").find(literal) != std::string_view::npos) form += '\\';
      form += literal;
    }
  }
  try {
    form_ = std::regex(form);
  } catch (const std::regex_error&) {
    form_ = std::regex();  // a set of a shell's own, [[:upper:]]: nothing matches
  }
}

std::string Wildcards::of(const std::filesystem::path& file) const {
  std::smatch found;
  const std::string name = file.string();
  std::string out;
  if (std::regex_match(name, found, form_))
    for (std::size_t k = 1; k < found.size(); ++k) out += found[k].str() + "/";
  return out;
}

}  // namespace fathom::topside
