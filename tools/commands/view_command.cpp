// SPDX-License-Identifier: GPL-3.0-or-later

// view

#include <array>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <thread>

#include <fmt/format.h>
#include <spawn.h>
#include <unistd.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "tools/commands/view_command.hpp"
#include "tools/view/view_export.hpp"
#include "tools/view/view_server.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
namespace {

/// With what the desktop has chosen for pages.
bool open_in_browser(const std::string& url) {
  std::array<char*, 3> words{const_cast<char*>("xdg-open"), const_cast<char*>(url.c_str()),
                             nullptr};
  pid_t child = 0;
  return ::posix_spawnp(&child, words[0], nullptr, nullptr, words.data(), environ) == 0;
}

Result<void> page_is_there() {
  if (!view_page().empty()) return {};
  return fail(kViewPage,
              "this maquette was built without the page that it would show: run "
              "tools/setup --web (node's packages), then build again");
}

}  // namespace

Command add_view(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path folder;
    int port = 8733;
    bool open = false;
    fs::path out;
    double most_mb = 10.0;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "view",
      "A page that shows what `lod` or `run` has written: the surface under a sun of yours,\n"
      "heights and profiles by click, stones, toolpaths, deviations. Served to this machine only, "
      "until Ctrl-C.\n"
      "Example: maquette view out\n"
      "         maquette view lod --port 0 --open\n"
      "         maquette view out --export page.html");
  app->add_option("folder", o->folder, "of `maquette lod` or `maquette run`")->required();
  app->add_option("--port", o->port, "on 127.0.0.1; 0: any that is free")
      ->capture_default_str()
      ->check(CLI::Range(0, 65535));
  app->add_flag("--open,!--no-browser", o->open, "opens the page in the desktop's browser");
  auto* out = app->add_option("--export", o->out,
                              "writes the page with its data inside instead: one file that needs "
                              "neither server nor network");
  app->add_option("--export-mb", o->most_mb,
                  "that it may weigh, 10^6 bytes; what is shown is as fine as fits")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 2000.0))
      ->needs(out);
  return {app, [o](Console& console) -> Result<int> {
            if (!o->out.empty()) {
              MAQUETTE_TRY_VOID(page_is_there());
              return finish(console, "export", [&](const RunContext& run) {
                return view_export_job(o->folder, o->out, view_page(), o->most_mb, run);
              });
            }
            MAQUETTE_TRY(const ViewServer server,
                         ViewServer::start(o->folder, o->port, view_page()));
            MAQUETTE_TRY_VOID(page_is_there());
            const std::string url = fmt::format("http://127.0.0.1:{}/", server.port());
            // At once, not at the end as other results.
            if (console.options().json)
              fmt::print("{}\n", nlohmann::json{{"url", url}}.dump());
            else
              fmt::print("{}\n", url);
            std::fflush(stdout);
            console.line(fmt::format("shows {}; Ctrl-C ends it", o->folder.string()));
            if (o->open && !open_in_browser(url))
              console.warning("there is no xdg-open; open the address yourself");
            while (!stop_requested()) std::this_thread::sleep_for(std::chrono::milliseconds(50));
            return 0;
          }};
}

}  // namespace maquette::tools
