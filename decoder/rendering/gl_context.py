"""The OpenGL context, and the programs, framebuffers and textures in it."""

import os
from importlib.resources import files
from typing import Any

import cv2
import moderngl
import numpy as np

from shared_model.arrays import Array, Picture, Single
from shared_model.errors import UserError


def create_context() -> moderngl.Context:
    """An offscreen OpenGL context.  Raises `UserError` where there is no EGL.

    Objects without references are freed when its `gc` is called.
    """
    # Mesa's llvmpipe, which draws in software, shall draw in the caller's thread.  A thread of its
    # own (in 22.3.6) still holds a fence's mutex when whoever reads the fence's count without it
    # frees the fence: the unlocking then writes to memory that is something else's by now.
    os.environ.setdefault("LP_NUM_THREADS", "0")
    try:
        context = moderngl.create_context(standalone=True, backend="egl")  # type: ignore[arg-type]
    except Exception as error:  # glcontext raises bare Exception, ImportError or OSError
        raise UserError(
            "cannot draw without a screen: no EGL with OpenGL 3.3; install libegl1 libgl1"
        ) from error
    context.gc_mode = "context_gc"
    return context


def load_program(
    context: moderngl.Context, name: str, vertex: str | None = None
) -> moderngl.Program:
    """The program of the fragment shader `name` and a vertex shader, of that name if not stated."""
    folder = files("decoder") / "shaders"
    return context.program(
        vertex_shader=(folder / f"{vertex or name}.vert").read_text(),
        fragment_shader=(folder / f"{name}.frag").read_text(),
    )


def write_uniform(program: moderngl.Program, name: str, matrix: Array) -> None:
    """Set a uniform matrix of a program."""
    uniform = program[name]
    assert isinstance(uniform, moderngl.Uniform)
    uniform.write(as_float32(matrix.T))


def create_framebuffer(
    context: moderngl.Context, size: tuple[int, int], samples: int
) -> moderngl.Framebuffer:
    """A framebuffer of `size` (width, height), pixels, with `samples` colour samples per pixel."""
    depth = context.depth_renderbuffer(size, samples=samples)
    return context.framebuffer([context.renderbuffer(size, 4, samples=samples)], depth)


def upload_picture(
    context: moderngl.Context, texture: moderngl.Texture | None, name: str, picture: Picture
) -> moderngl.Texture:
    """A texture of the picture (h, w, 3 or 4) uint8: `texture` if that has its shape, or a new one.

    name: of the picture, for the message.  Raises `ValueError` for another shape or type.
    """
    if picture.ndim != 3 or picture.shape[2] not in (3, 4) or picture.dtype != np.uint8:
        raise ValueError(
            f"{name} is {picture.dtype} {picture.shape}, expected uint8 (h, w, 3 or 4)"
        )
    height, width, components = picture.shape
    if texture is None or (*texture.size, texture.components) != (width, height, components):
        texture = context.texture((width, height), components, alignment=1)
        texture.repeat_x = texture.repeat_y = False
    texture.write(np.ascontiguousarray(picture), alignment=1)
    return texture


def write_mipmaps(texture: moderngl.Texture, picture: Picture, levels: int) -> None:
    """Write the first mipmap levels of a texture that has some: a fifth of llvmpipe's time.

    picture: (h, w, 3 or 4) uint8, as the texture has it.
    """
    for level in range(1, min(levels, max(texture.size).bit_length() - 1) + 1):
        width, height = (max(side >> level, 1) for side in texture.size)
        small = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
        picture = np.ascontiguousarray(small, np.uint8)
        texture.write(picture, level=level, alignment=1)


def as_float32(array: Any) -> Single:
    """The array as buffers and uniforms take it."""
    return np.ascontiguousarray(array, dtype=np.float32)
