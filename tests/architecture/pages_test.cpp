// What the pages name is there: links, paths, tests of requirements, the version of the newest changes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string_view>

#include "tests/support/test_data.hpp"
#include "tests/support/text_files.hpp"

namespace fathom::test {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

const fs::path kProject = FATHOM_SOURCE_DIR;
constexpr std::array<std::string_view, 7> kPageFolders{".ci",       "firmware_if", "realtime", "recon",
                                                       "telemetry", "sim",         "tests"};

// Every file of the project's folders below `root`, fetched and generated ones left out.
void forEachProjectFile(const fs::path& root, const std::function<void(const fs::path&)>& visit) {
  for (const std::string_view folder : kPageFolders) {
    if (!fs::exists(root / folder)) continue;
    for (fs::recursive_directory_iterator entry(root / folder), end; entry != end; ++entry) {
      const fs::path name = entry->path().filename();
      if (name == "node_modules" || name == "dist") entry.disable_recursion_pending();
      if (entry->is_regular_file()) visit(entry->path());
    }
  }
}

// Each page with its lines outside of blocks of code.
using Pages = std::map<std::string, std::vector<std::string>>;
Pages readPages(const fs::path& root) {
  Pages pages;
  const auto read = [&](const fs::path& path) {
    if (path.filename() != "README.md" && path.filename() != "CONTRIBUTING.md") return;
    std::vector<std::string>& lines = pages[path.lexically_relative(root).generic_string()];
    std::istringstream text(readText(path));
    bool code = false;
    for (std::string line; std::getline(text, line);) {
      if (line.starts_with("```")) code = !code;
      if (!code) lines.push_back(line);
    }
  };
  read(root / "README.md");
  forEachProjectFile(root, read);
  return pages;
}

// The first group of every match in a line.
std::vector<std::string> namedIn(const std::string& line, const std::regex& pattern) {
  std::vector<std::string> names;
  for (std::sregex_iterator it(line.begin(), line.end(), pattern), none; it != none; ++it)
    names.push_back((*it)[1]);
  return names;
}

// The path or a source of that name exists; '*' in its last part stands for any characters.
bool isThere(const fs::path& path) {
  const std::string name = path.filename().string();
  if (name.find('*') == std::string::npos)
    return fs::exists(path) || fs::exists(path.string() + ".hpp") || fs::exists(path.string() + ".cpp");
  if (!fs::is_directory(path.parent_path())) return false;
  const std::regex pattern(std::regex_replace(name, std::regex(R"(\*)"), ".*"));
  return std::any_of(
      fs::directory_iterator(path.parent_path()), fs::directory_iterator(),
      [&](const auto& entry) { return std::regex_match(entry.path().filename().string(), pattern); });
}

std::string lineOf(const std::string& page, const std::string& what) {
  return page + ": " + what;
}

// "page: path" of every link, and of every path in backticks from one of the folders on, that is not there.
// What follows a path in its backticks, as a command's options, is left out.
std::vector<std::string> deadPaths(const fs::path& root) {
  static const std::regex link(R"(\]\(([^)#:]+)(?:#[^)]*)?\))");
  static const std::regex quoted(R"(`([A-Za-z0-9_.*-]+/[A-Za-z0-9_.*/-]*)[^`]*`)");
  std::vector<std::string> dead;
  for (const auto& [page, lines] : readPages(root))
    for (const std::string& line : lines) {
      for (const std::string& path : namedIn(line, link))
        if (!fs::exists((root / page).parent_path() / path)) dead.push_back(lineOf(page, path));
      for (const std::string& path : namedIn(line, quoted)) {
        const std::string_view folder = std::string_view(path).substr(0, path.find('/'));
        const bool ours = std::find(kPageFolders.begin(), kPageFolders.end(), folder) != kPageFolders.end();
        if (ours && !isThere(root / path)) dead.push_back(lineOf(page, path));
      }
    }
  return dead;
}

// "Suite.Name" of every test in tests/.
std::set<std::string> readTests(const fs::path& root) {
  static const std::regex pattern(R"(\bTEST(?:_F|_P)?\(\s*(\w+),\s*(\w+)\))");
  std::set<std::string> tests;
  forEachProjectFile(root, [&](const fs::path& path) {
    if (path.extension() != ".cpp" || *path.lexically_relative(root).begin() != "tests") return;
    const std::string text = readText(path);
    for (std::sregex_iterator it(text.begin(), text.end(), pattern), none; it != none; ++it)
      tests.insert((*it)[1].str() + "." + (*it)[2].str());
  });
  return tests;
}

// A row "| NAV-001 | requirement | `Suite.Name`, ... |" of a component's page.
const std::regex kRequirement(R"(^\| ([A-Z]{3}-\d{3}) \| .* \| ([^|]*) \|$)");
const std::regex kTest(R"(`([A-Z]\w*\.[A-Z]\w*)`)");

// "page: what" of every test in backticks that is none, every requirement that names no test, and every
// identifier of one that is there twice.
std::vector<std::string> unshown(const fs::path& root) {
  const std::set<std::string> tests = readTests(root);
  std::set<std::string> ids;
  std::vector<std::string> wrong;
  for (const auto& [page, lines] : readPages(root))
    for (const std::string& line : lines) {
      for (const std::string& test : namedIn(line, kTest))
        if (tests.count(test) == 0) wrong.push_back(lineOf(page, "no test " + test));
      std::smatch row;
      if (!std::regex_match(line, row, kRequirement)) continue;
      if (namedIn(row[2], kTest).empty()) wrong.push_back(lineOf(page, row[1].str() + " names no test"));
      if (!ids.insert(row[1]).second) wrong.push_back(lineOf(page, row[1].str() + " twice"));
    }
  return wrong;
}

TEST(Pages, EveryLinkAndPathThatAPageNamesExists) {
  EXPECT_THAT(deadPaths(kProject), IsEmpty());
}

TEST(Pages, ADeadLinkOrPathIsFound) {
  const TemporaryFolder tree;
  writeText(tree.path() / "recon/navigation/filter.cpp", "");
  writeText(
      tree.path() / "recon/navigation/README.md",
      "`recon/navigation/filter`, `recon/navigation/fil*.cpp`, [here](filter.cpp#top), `topside/layers/`\n"
      "```\n`recon/in_code`\n```\n[up](../absent.md) `recon/navigation/fal*.cpp` `tests/gone 1 2`\n");
  writeText(tree.path() / "README.md",
            "[web](https://a.org/b) [folder](recon/navigation) [page](navigation/README.md)\n");
  EXPECT_THAT(
      deadPaths(tree.path()),
      UnorderedElementsAre("README.md: navigation/README.md", "recon/navigation/README.md: ../absent.md",
                           "recon/navigation/README.md: recon/navigation/fal*.cpp",
                           "recon/navigation/README.md: tests/gone"));
}

// The words of a line in lower case; a capital begins one.
std::vector<std::string> wordsOf(const std::string& line) {
  std::vector<std::string> words;
  bool lower = false, inside = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    const bool capital = c >= 'A' && c <= 'Z', letter = capital || (c >= 'a' && c <= 'z');
    const bool begins =
        capital && i + 1 < line.size() && line[i + 1] >= 'a' && line[i + 1] <= 'z';  // as "ANew"
    if (letter && (!inside || begins || (capital && lower))) words.emplace_back();
    if (letter) words.back() += static_cast<char>(capital ? c - 'A' + 'a' : c);
    inside = letter, lower = letter && !capital;
  }
  return words;
}

// Words of everyday speech for which the field has terms (tests/GLOSSARY.md) stand nowhere in code, comments,
// messages and pages, alone or as a part of a name, but in keys that users have, in the SLIP protocol and in
// trust regions.
TEST(Pages, TextUsesTheTermsOfTheField) {
  const std::set<std::string> everyday{
      "anew",     "belief", "believe", "believed", "believes", "heard",  "hears",   "honest",
      "honestly", "lie",    "lied",    "lies",     "mend",     "mended", "mending", "mends",
      "skirt",    "skirts", "slip",    "slipped",  "slips",    "told",   "trust",   "trusted",
      "trusts",   "vouch",  "vouched", "vouches",  "way",      "ways",   "who",     "whom"};
  const std::regex key(
      R"([Tt]rust[ _]?[Rr]egion|SLIP|[Ss]lip(Encode|Decoder|Bytes)|[Ss]lip[.,_ ]|\(Slip,|slipped_cycles|["']slipped["']|mend_rig|--mended|"mended"|)"
      R"((heard|HEARD)\.bin|--heard|heard_ago|"heard"|\.heard\b|boolean heard|share_told|directions_told|dvl_lies|given_way)");
  const std::set<std::string> kinds{".cpp", ".hpp", ".html", ".lcm", ".md",
                                    ".mjs", ".py",  ".toml", ".ts",  ".txt"};
  const auto first = [&](const std::string& line) -> std::string {
    for (const std::string& word : wordsOf(line))
      if (everyday.count(word) != 0) return word;
    return "";
  };
  EXPECT_EQ(first("kept allTheWay"), "way");
  std::size_t lines = 0;
  forEachProjectFile(kProject, [&](const fs::path& path) {
    if (kinds.count(path.extension().string()) == 0 || path.filename() == "pages_test.cpp") return;
    std::istringstream text(readText(path));
    int number = 0;
    for (std::string line; std::getline(text, line); ++lines) {
      ++number;
      if (first(line).empty()) continue;
      EXPECT_EQ(first(std::regex_replace(line, key, " ")), "")
          << path.lexically_relative(kProject) << ":" << number;
    }
  });
  EXPECT_GT(lines, 100'000U);
}

TEST(Pages, EveryRequirementIsShownByATestThatExists) {
  EXPECT_THAT(unshown(kProject), IsEmpty());
  std::map<std::string, int> requirements;
  for (const auto& [page, lines] : readPages(kProject))
    for (const std::string& line : lines)
      if (std::regex_match(line, kRequirement)) ++requirements[line.substr(2, 3)];
  for (const char* component : {"NAV", "MAP", "LNK", "REC"})
    EXPECT_GE(requirements[component], 8) << component;
}

TEST(Pages, ARequirementWithoutItsTestIsFound) {
  const TemporaryFolder tree;
  writeText(tree.path() / "tests/nav/a_test.cpp", "TEST(Track, Holds) {}\nTEST_F(Gate,\n       Closes) {}\n");
  writeText(tree.path() / "recon/README.md",
            "| NAV-001 | holds | `Track.Holds`, `Gate.Closes` |\n| NAV-002 | opens | `Gate.Opens` |\n"
            "| NAV-001 | holds again | `Track.Holds` |\n| NAV-003 | somehow | by inspection |\n");
  EXPECT_THAT(unshown(tree.path()),
              ElementsAre("recon/README.md: no test Gate.Opens", "recon/README.md: NAV-001 twice",
                          "recon/README.md: NAV-003 names no test"));
}

TEST(Pages, TheNewestChangesAreThoseOfTheProjectsVersion) {
  std::istringstream changes(readText(kProject / ".ci/package/CHANGES.md"));
  std::string line;
  while (std::getline(changes, line) && !line.starts_with("## ")) continue;
  EXPECT_EQ(line, "## " FATHOM_VERSION);
}

}  // namespace
}  // namespace fathom::test
