#include "realtime/base/input_error.hpp"

#include <cstdio>
#include <exception>

#include "realtime/base/text.hpp"

namespace fathom {
InputError::InputError(const std::string& file, const std::string& place, const std::string& fix)
    : std::runtime_error(printableText(file + ": " + (place.empty() ? "" : place + ": ") + fix)) {}

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
