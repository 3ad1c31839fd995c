#pragma once

#include <filesystem>
#include <optional>
#include <string_view>

namespace httplib {
struct Request;
struct Response;
}  // namespace httplib

namespace fathom::web {

// The file inside `root` that a request's path names (already percent-decoded, relative, with slashes), or
// none: for an absent file, a folder, an empty path, and any path that would leave the folder ("..", an
// absolute path, a backslash, a NUL). Links inside the folder are followed: who made them owns the folder.
[[nodiscard]] std::optional<std::filesystem::path> fileInside(const std::filesystem::path& root,
                                                              std::string_view request);

// Answers with that file, or the ranges of it that were asked for, piece by piece; without one, 404. The
// type is told by the name's ending.
void sendFile(const std::optional<std::filesystem::path>& file, const httplib::Request& request,
              httplib::Response& response);

}  // namespace fathom::web
