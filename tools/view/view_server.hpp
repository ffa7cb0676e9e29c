// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_server.hpp
/// HTTP for one browser on this machine: the page, the files of one folder read-only, and rasters
/// as the page asks for them.
///
///   GET /                               the page
///   GET /maquette.json                  what there is (tools/view/view_contents.hpp)
///   GET /files/PATH                     a file of the folder; byte ranges
///   GET /grid?file=PATH&nodes=N[&mean=1]
///                                       float32, little-endian, row by row from the south; header
///                                       Maquette-Grid says how many and where (ThinnedField)
///   GET /tile?file=PATH&row=R&col=C&every=N&quads=Q
///                                       float32 of a square of every n-th node (every_nth)
///   GET /picture?file=PATH&most=N[&linear=1]
///                                       a photograph or rendering as PNG of at most N pixels a
///                                       side (view_picture.hpp)
///   GET /profile?file=PATH&from=X,Y&to=X,Y&count=N
///                                       {"values": [...]}: mm, null where there is none
///
/// Listens on 127.0.0.1 only. A request whose Host is neither that nor localhost with our port is
/// refused (403): a name that another site has turned to 127.0.0.1 reads nothing. The page may load
/// from here only, by its Content-Security-Policy. What is not below the folder does not exist
/// (view_files.hpp). Nothing is written, and no method but GET and HEAD is known.

#include <filesystem>
#include <memory>
#include <span>

#include "core/result.hpp"
#include "tools/view/view_page.hpp"

namespace maquette::tools {

inline constexpr ErrorCode kPortTaken{"TOOLS_PORT_TAKEN", ErrorKind::environment};

class ViewServer {
 public:
  /// Serves until it is destroyed, in threads of its own.
  /// @param port  0: any that is free
  /// @return view_contents_json's errors; TOOLS_PORT_TAKEN with the system's reason
  [[nodiscard]] static Result<ViewServer> start(const std::filesystem::path& folder, int port,
                                                std::span<const PageFile> page);
  ViewServer(ViewServer&&) noexcept;
  ViewServer& operator=(ViewServer&&) noexcept;
  ~ViewServer();

  [[nodiscard]] int port() const;

 private:
  struct State;
  explicit ViewServer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace maquette::tools
