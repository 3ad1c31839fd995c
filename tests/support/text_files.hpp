#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string_view>
#include <vector>

#include "realtime/base/input_error.hpp"

namespace fathom::test {

// Makes the file's folder too.
inline void writeText(const std::filesystem::path& path, std::string_view text) {
  std::filesystem::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

inline void writeBytes(const std::filesystem::path& path, const std::vector<std::uint8_t>& bytes) {
  writeText(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

inline std::string readText(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline std::vector<std::uint8_t> readBytes(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

inline std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  return at == std::string::npos ? "no '" + from + "' to replace" : text.replace(at, from.size(), to);
}

// The line of the InputError that `work` throws; "" if it throws none.
template <class Work>
std::string refusal(Work work) {
  try {
    work();
  } catch (const InputError& e) {
    return e.what();
  }
  return "";
}

}  // namespace fathom::test
