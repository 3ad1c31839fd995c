#include "realtime/kernel/input_error.hpp"

#include <cstdio>
#include <exception>

namespace fathom {
namespace {

std::string oneLine(std::string text) {
  constexpr unsigned char kFirstPrintable = 0x20, kDelete = 0x7f;
  for (char& c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte < kFirstPrintable || byte == kDelete) c = '?';
  }
  return text;
}

}  // namespace

InputError::InputError(const std::string& file, const std::string& place, const std::string& fix)
    : std::runtime_error(oneLine(file + ": " + (place.empty() ? "" : place + ": ") + fix)) {}

int runTool(const char* program, const std::function<int()>& body) noexcept {
  try {
    return body();
  } catch (const InputError& e) {
    std::fprintf(stderr, "%s: %s\n", program, e.what());
    return kExitBadInput;
  } catch (const std::exception& e) {
    std::fprintf(stderr, "%s: failed: %s\n", program, e.what());
    return kExitFailedWork;
  }
}

}  // namespace fathom
