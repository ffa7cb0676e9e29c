// SPDX-License-Identifier: GPL-3.0-or-later

// The one program. Exit codes (docs/errors.md): 0 done, 1 a tolerance that was
// asked for is not met, 2 bad input, 3 environment, 4 our bug.

#include <memory>
#include <new>
#include <thread>

#include <fmt/format.h>
#include <oneapi/tbb/global_control.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/check.hpp"
#include "tools/commands/camera_commands.hpp"
#include "tools/commands/view_command.hpp"
#include "tools/version.hpp"

namespace maquette::tools {
namespace {

int report(Console& console, std::string_view code, int exit_code, const std::string& message) {
  console.error(message);
  console.json_result(nlohmann::json{
      {"error", {{"code", code}, {"message", message}}},
      {"exit_code",
       exit_code}}.dump(1));
  return exit_code;
}

int run_program(int argc, char** argv) {
  CLI::App root(
      "maquette: planetary elevation data to physical scale models, and how good they are.\n"
      "Start with: maquette init --out site.toml && maquette run site.toml --out out");
  root.name("maquette");
  CommonOptions common;
  root.set_version_flag("--version", std::string("maquette ") + kVersion);
  root.require_subcommand(1);
  root.fallthrough();
  root.add_flag("--json", common.json, "one JSON document on standard output");
  root.add_flag("--quiet", common.quiet, "no progress, only warnings and errors");
  root.add_option("--threads", common.threads, "0: one per core; the result does not depend on it")
      ->check(CLI::Range(0, 1024));
  root.add_option("--seed", common.seed, "of what is drawn at random")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000'000'000'000}));
  const std::vector<Command> commands{
      add_init(root, common),       add_run(root, common),         add_fuse(root, common),
      add_stones(root, common),     add_stone_parts(root, common), add_mesh(root, common),
      add_bands(root, common),      add_mill(root, common),        add_spheres(root, common),
      add_verify(root, common),     add_backplot(root, common),    add_export(root, common),
      add_lod(root, common),        add_render(root, common),      add_compare(root, common),
      add_scan(root, common),       add_clean(root, common),       add_merge(root, common),
      add_deviate(root, common),    add_diagnose(root, common),    add_detectability(root, common),
      add_compensate(root, common), add_info(root, common),        add_doctor(root, common),
      add_expose(root, common),     add_stack(root, common),       add_view(root, common),
      add_calibrate(root, common),  add_match(root, common),       add_sheet(root, common),
      add_simplify(root, common)};
  for (CLI::App* verb : root.get_subcommands({})) verb->fallthrough();

  try {
    root.parse(argc, argv);
  } catch (const CLI::CallForHelp& e) {
    return root.exit(e);
  } catch (const CLI::CallForVersion& e) {
    return root.exit(e);
  } catch (const CLI::ParseError& e) {
    Console console({common.quiet, common.json});
    return report(console, kUsage.name, static_cast<int>(ErrorKind::bad_input),
                  fmt::format("{}; see maquette --help", e.what()));
  }

  install_stop_handlers();
  std::unique_ptr<oneapi::tbb::global_control> limit;
  if (common.threads > 0)
    limit = std::make_unique<oneapi::tbb::global_control>(
        oneapi::tbb::global_control::max_allowed_parallelism,
        static_cast<std::size_t>(common.threads));
  Console console({common.quiet, common.json});
  for (const Command& command : commands) {
    if (!command.app->parsed()) continue;
    const auto done = command.action(console);
    if (done) return *done;
    return report(console, done.error().code.name, static_cast<int>(done.error().code.kind),
                  done.error().message);
  }
  return 0;
}

}  // namespace
}  // namespace maquette::tools

int main(int argc, char** argv) {
  using maquette::ErrorKind;
  try {
    return maquette::tools::run_program(argc, argv);
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "error: not enough memory; use a smaller size_mm or coarser spacing_mm\n");
    return static_cast<int>(ErrorKind::environment);
  } catch (const std::exception& e) {
    fmt::print(stderr,
               "error: internal: {}\nThis is a bug of maquette; please report it with the command "
               "and its input.\n",
               e.what());
    return static_cast<int>(ErrorKind::internal);
  }
}
