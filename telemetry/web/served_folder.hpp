#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

#include "telemetry/web/exchange.hpp"

namespace fathom::web {

// The file inside `root` that a request's path names (already percent-decoded, relative, with slashes), or
// none: for an absent file, a folder, an empty path, and any path that would leave the folder ("..", an
// absolute path, a backslash, a NUL). Links inside the folder are followed: they belong to the folder's
// owner.
[[nodiscard]] std::optional<std::filesystem::path> fileInside(const std::filesystem::path& root,
                                                              std::string_view request);

// That file, or the one range of it that was asked for; without one, 404, and 416 for a range that begins
// after its end. The type follows from the name's ending.
[[nodiscard]] Response fileResponse(const std::optional<std::filesystem::path>& file,
                                    const HttpRequest& request);

// Files of unknown origin, such as a dive's: none of them can run in the browser. What a browser would run
// (HTML, SVG, scripts, styles) is sent as a download.
[[nodiscard]] Response dataResponse(const std::optional<std::filesystem::path>& file,
                                    const HttpRequest& request);

// Whether a file is a picture by its name's ending and, where it is a link, by that of what it leads to.
[[nodiscard]] bool isPicture(const std::filesystem::path& file);

}  // namespace fathom::web
