"""JAX's cache of compiled code, kept between processes."""

from __future__ import annotations

from pathlib import Path

import jax

from cableway.core.user_cache import private_folder, user_folder


def compilation_cache_folder() -> Path:
    """Folder of JAX's compiled code, in the user's cache folder."""
    return user_folder() / "jax"


def enable_compilation_cache() -> bool:
    """Let JAX keep what it compiles in `compilation_cache_folder()`, and use what is there.

    It changes JAX's global configuration, so it is for programs, not for libraries. A folder that the user set
    (`JAX_COMPILATION_CACHE_DIR`) stays as it is. JAX unpickles what it finds, so where the other one is not the user's
    alone nothing is kept, see `cableway.core.user_cache`.

    Returns:
        Whether the folder already holds compiled code.
    """
    chosen = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    folder = Path(chosen) if chosen else compilation_cache_folder()
    if not chosen and private_folder(folder) is None:
        jax.config.update("jax_enable_compilation_cache", False)
        return False
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return folder.is_dir() and any(folder.iterdir())
