#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace fathom::viewer {

// The file inside `root` that a request's path names (already percent-decoded, relative, with slashes), or
// none: for an absent file, a folder, an empty path, and any path that would leave the folder ("..", an
// absolute path, a backslash, a NUL). Links inside the folder are followed: who made them owns the folder.
[[nodiscard]] std::optional<std::filesystem::path> fileInside(const std::filesystem::path& root,
                                                              std::string_view request);

// MIME type by the name's ending; "application/octet-stream" for those unknown.
[[nodiscard]] std::string_view contentType(const std::filesystem::path& file);

// Whether the Host header of a request names this machine (127.0.0.1, localhost or [::1], with any port): a
// page of another site cannot then be pointed at this server by a name of its own.
[[nodiscard]] bool namesThisMachine(std::string_view host);

}  // namespace fathom::viewer
