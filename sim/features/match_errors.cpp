#include "sim/features/match_errors.hpp"

#include <algorithm>
#include <fstream>
#include <sstream>
#include <string>

#include "realtime/base/input_error.hpp"
#include "realtime/base/install_prefix.hpp"

namespace fathom::sim {
namespace {

constexpr std::size_t kMostRows = 10'000;

}  // namespace

std::filesystem::path MatchErrors::shipped() {
  return installPrefix() / "share/fathom/scenarios/match-errors.csv";
}

MatchErrors::MatchErrors(const std::filesystem::path& file) {
  std::ifstream stream(file);
  if (!stream) throw InputError(file.string(), "", "cannot be read; give a file of match errors");
  std::string line;
  std::getline(stream, line);
  if (line != kHeader) throw InputError(file.string(), "line 1", std::string("write the header ") + kHeader);
  for (std::size_t number = 2; std::getline(stream, line); ++number) {
    const std::string place = "line " + std::to_string(number);
    const auto refuse = [&](const char* fix) { throw InputError(file.string(), place, fix); };
    if (number > kMostRows) refuse("is one too many; leave rows out");
    std::istringstream cells(line);
    for (std::size_t k = 0; k < kColumns; ++k) {
      double value = 0;
      char comma = ',';
      if ((k > 0 && !(cells >> comma)) || comma != ',' || !(cells >> value) || !(value >= 0))
        refuse("write six numbers from 0 up, separated by commas");
      if (!columns_[k].empty() && value < columns_[k].back())
        refuse("is below the row before it; sort each column");
      columns_[k].push_back(value);
    }
    if (cells >> std::ws; !cells.eof()) refuse("has more than six numbers");
  }
  const std::vector<double>& share = columns_[kShare];
  if (share.size() < 2 || share.front() != 0 || share.back() != 1)
    throw InputError(file.string(), "column share", "must run from 0 to 1");
}

double MatchErrors::between(Column at, double value, Column wanted) const {
  const std::vector<double>&x = columns_[at], &y = columns_[wanted];
  const auto after = static_cast<std::size_t>(std::upper_bound(x.begin(), x.end(), value) - x.begin());
  if (after == 0) return y.front();
  if (after == x.size()) return y.back();
  const double t = (value - x[after - 1]) / (x[after] - x[after - 1]);
  return y[after - 1] + t * (y[after] - y[after - 1]);
}

}  // namespace fathom::sim
