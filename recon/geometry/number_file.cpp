#include "recon/geometry/number_file.hpp"

#include <cmath>
#include <exception>
#include <fstream>

#include "realtime/kernel/input_error.hpp"

namespace fathom {

NumberFile::NumberFile(const std::filesystem::path& path, const std::string& what) : path_(path) {
  std::ifstream in(path);
  std::error_code error;
  if (!in || std::filesystem::is_directory(path, error))
    throw InputError(path, "", "cannot be read; give " + what);
  std::string token;
  while (in >> token) {
    std::size_t used = 0;
    double value = 0.0;
    try {
      value = std::stod(token, &used);
    } catch (const std::exception&) {
      used = 0;
    }
    if (used != token.size() || !std::isfinite(value))
      throw InputError(path, "number " + std::to_string(numbers_.size() + 1),
                       "'" + token.substr(0, 40) + "' is not a number");
    numbers_.push_back(value);
  }
}

void NumberFile::fail(const std::string& fix) const {
  throw InputError(path_, "number " + std::to_string(index_), fix);
}

}  // namespace fathom
