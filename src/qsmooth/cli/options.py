"""Options of the command line, made from the fields of the methods' option classes.

Nothing is written here about any one of them: a new field is a new option of the shell.
"""

from __future__ import annotations

import copy
import functools
import inspect
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    get_args,
    get_origin,
    get_type_hints,
)

import typer

from qsmooth._words import did_you_mean, in_a_row
from qsmooth.options import Spec, spelled

if TYPE_CHECKING:
    from qsmooth.methods.base import Method

# Names of panels in the help.
FILES, METHOD, REPORT = "Files", "Smoothing", "Report"


@dataclass(frozen=True)
class Command:
    """A command and where its made options come from.

    Attributes
    ----------
    function
        What Typer calls. Its parameter ``options``, if it has one, stands for the made options: a
        dict of those that were given, by their names in Python. In the help of its other options
        ``{methods}``, ``{auto}``, ``{metrics}`` and ``{short}`` stand for names.
    methods
        Gives the methods whose options it offers.
    only
        Names of those that it offers, where it does not offer all.
    """

    function: Callable[..., None]
    methods: Callable[[], Iterable[type[Method]]] = tuple
    only: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """As it is called in the shell."""
        return self.function.__name__

    def made(self) -> list[ShellOption]:
        """Make the options of the methods."""
        options = shell_options(self.methods())
        return [o for o in options if not self.only or o.name in self.only]


@dataclass(frozen=True)
class ShellOption:
    """An option of the shell: one for all methods that have an option of that name.

    Attributes
    ----------
    name
        As in Python.
    specs
        What is known of it, by the names of the methods that have it.
    panel
        Where it stands in the help.
    """

    name: str
    specs: Mapping[str, Spec]
    panel: str

    @property
    def usual(self) -> Spec:
        """What most methods have; of a choice, the one with the most to choose from."""
        if self.kind == "choice":
            return max(self.specs.values(), key=lambda spec: len(spec.choices))
        helps = Counter(spec.help for spec in self.specs.values())
        most = helps.most_common(1)[0][0]
        return next(spec for spec in self.specs.values() if spec.help == most)

    @property
    def kind(self) -> Literal["number", "integer", "flag", "choice", "object"]:
        """Kind of its values."""
        return next(iter(self.specs.values())).kind

    @property
    def choices(self) -> dict[str, Any]:
        """What can be chosen, as it is written in a shell; True and False are only for Python."""
        values = [value for spec in self.specs.values() for value in spec.choices]
        return {str(value): value for value in values if not isinstance(value, bool)}

    @property
    def flags(self) -> list[str]:
        """Its names in a shell, the one that is shown in messages first."""
        names = [shell_name(self.usual), self.name.replace("_", "-")]
        return [f"--{name}" for name in dict.fromkeys(names)]

    @property
    def default(self) -> str:
        """Its default in words; nothing where that is not to be given at all."""
        return _by_method({name: default_words(spec) for name, spec in self.specs.items()})

    @property
    def range(self) -> str:
        """Its range in words: "in (0, 1]"; nothing where it has none."""
        return _by_method({name: range_words(spec) for name, spec in self.specs.items()})

    @property
    def help(self) -> str:
        """What it is for, its range, its default; and where these are not the same for all."""
        usual = self.usual
        said = [usual.help]
        if self.kind == "choice":
            said += [self._only_of(choice) for choice in self.choices.values()]
        else:
            others = [(m, s.help) for m, s in self.specs.items() if s.help != usual.help]
            said += [f"Of {name}: {text[0].lower()}{text[1:]}" for name, text in others]
        if self.range:
            said.append(f"{self.range[0].upper()}{self.range[1:]}.")
        text = _escape(spelled(" ".join(filter(None, said)), spell))
        return text + (f"  [dim]\\[default: {_escape(self.default)}][/dim]" if self.default else "")

    def _only_of(self, choice: Any) -> str:
        having = [name for name, spec in self.specs.items() if choice in spec.choices]
        return "" if len(having) == len(self.specs) else f"({choice}: only of {in_a_row(having)}.)"

    def parameter(self) -> inspect.Parameter:
        """Declare it for Typer."""
        flags = self.flags
        metavar = self.usual.metavar or {"number": "NUMBER", "integer": "N"}.get(self.kind)
        annotation: Any = {"number": float, "integer": int, "flag": bool}.get(self.kind, str)
        if self.usual.repeats:
            annotation = list[annotation]
        if self.kind == "choice":
            metavar = (
                f"[{'|'.join(self.choices)}]"  # others are refused by the method, in its words
            )
        elif self.kind == "flag":
            flags = [f"{flag}/--no-{flag.removeprefix('--')}" for flag in flags]
        info = typer.Option(
            *flags,
            help=self.help,
            metavar=metavar,
            autocompletion=(lambda: list(self.choices)) if self.kind == "choice" else None,
            rich_help_panel=self.panel,
            show_default=False,
        )
        return inspect.Parameter(
            self.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[annotation | None, info],
        )

    def value(self, given: Any) -> Any:
        """Make a value of what the shell gives."""
        if self.kind == "choice":
            return self.choices.get(given, given)
        parse = self.usual.parse
        return given if parse is None else parse(given)


def shell_options(classes: Iterable[type[Method]]) -> list[ShellOption]:
    """Make one option of each name that methods have; those that all have come first."""
    specs: dict[str, dict[str, Spec]] = {}
    classes = list(classes)
    for known in classes:
        for name, spec in known.specs().items():
            if spec.flag is not None:
                specs.setdefault(name, {})[known.name] = spec
    every = [known.name for known in classes]
    options = [ShellOption(name, of, _panel(list(of), every)) for name, of in specs.items()]
    groups = list(dict.fromkeys(option.panel for option in options))
    groups.sort(key=lambda panel: panel != METHOD)
    return [option for panel in groups for option in options if option.panel == panel]


def with_options(command: Command, *, made: bool = True) -> Callable[..., None]:
    """Give a command its made options, for Typer; without any it is only good to be listed."""
    function = command.function
    options = {option.name: option for option in command.made()} if made else {}
    hints = get_type_hints(function, include_extras=True)
    parameters: list[inspect.Parameter] = []
    takes_options = False
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name == "options":
            takes_options = True
            parameters += [option.parameter() for option in options.values()]
        else:
            hint = _filled(hints[parameter.name]) if made else hints[parameter.name]
            kind = inspect.Parameter.KEYWORD_ONLY
            parameters.append(parameter.replace(annotation=hint, kind=kind))

    @functools.wraps(function)
    def wrapper(**given: Any) -> None:
        own = {name: value for name, value in given.items() if name not in options}
        if takes_options:
            own["options"] = {
                name: option.value(given[name])
                for name, option in options.items()
                if given[name] is not None
            }
        function(**own)

    del wrapper.__wrapped__  # it has another signature
    wrapper.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    wrapper.__annotations__ = {p.name: p.annotation for p in parameters}
    return wrapper


def shell_name(spec: Spec) -> str:
    """Name of an option in a shell, without dashes."""
    return spec.flag or spec.name.replace("_", "-")


def spell(named: str) -> str:
    """Write an option as a shell does: "max_sweeps" is "--sweeps"; with a value or without."""
    from qsmooth.registry import all_methods

    name, _, value = named.partition("=")
    specs = [known.specs()[name] for known in all_methods().values() if name in known.specs()]
    flag = shell_name(specs[0]) if specs else name.replace("_", "-")
    if value in ("True", "False"):
        return f"--{flag}" if value == "True" else f"--no-{flag}"
    return f"--{flag} {value.strip(chr(39))}" if value else f"--{flag}"


def named(options: Mapping[str, Any]) -> dict[str, Any]:
    """Name options as the shell does, without dashes, for JSON."""
    return {spell(name)[2:].replace("-", "_"): value for name, value in options.items()}


def default_words(spec: Spec) -> str:
    """Write a default as in a shell; nothing where it means that the option is not given."""
    default = spec.default
    if spec.default_words:
        return spelled(spec.default_words, spell)
    if spec.kind == "flag":
        return f"{'' if default else 'no-'}{shell_name(spec)}"
    if default is None or isinstance(default, bool):
        return ""
    return f"{default:g}" if isinstance(default, float) else str(default)


def range_words(spec: Spec) -> str:
    """Write the range of a number; choices stand beside the name of their option."""
    return "" if spec.interval is None else spec.interval.words(spec.unit)


def _escape(text: str) -> str:
    """Keep what looks like markup from being taken for it, as rich.markup would, slow to load."""
    return re.sub(r"(\\*)(\[[a-z#/@][^[]*?])", r"\1\1\\\2", text)


def _panel(having: list[str], every: list[str]) -> str:
    """Name the panel of the options that some methods have: by these, or by those that don't."""
    others = [name for name in every if name not in having]
    if not others:
        return METHOD
    few = having if len(having) <= len(others) else others
    return f"Options of {'all but ' if few is others else ''}{in_a_row(few)}"


def _by_method(words: Mapping[str, str]) -> str:
    """Say what most methods have, and which have something else: "0.25; angle 1"."""
    usual = Counter(words.values()).most_common(1)[0][0]
    others = ", ".join(f"{name} {text or 'none'}" for name, text in words.items() if text != usual)
    return "; ".join(filter(None, [usual, others]))


def _filled(hint: Any) -> Any:
    """Put names into the help of an option, where it asks for them."""
    if get_origin(hint) is not Annotated:
        return hint
    kind, info = get_args(hint)
    if "{" not in (info.help or ""):
        return hint
    info = copy.copy(info)
    for key, words in _NAMES.items():
        if f"{{{key}}}" in info.help:
            info.help = info.help.replace(f"{{{key}}}", words())
    return Annotated[kind, info]


def check_names(names: Iterable[str], known: Collection[str]) -> None:
    """Refuse an argument NAME that is none of the known ones; ValueError says what was meant."""
    for name in names:
        if name not in known:
            raise ValueError(
                f"NAME is one of {', '.join(known)}; got {name!r}{did_you_mean(name, known)}"
            )


def _method_names() -> str:
    from qsmooth.registry import methods

    return ", ".join(n + ("" if m.guarded else " (unguarded)") for n, m in methods().items())


def _auto() -> str:
    from qsmooth.registry import choose

    return choose({})[0]


def _metric_names() -> str:
    from qsmooth.metrics import METRICS

    return ", ".join(METRICS)


def _short_metrics() -> str:
    from qsmooth.metrics import parse_metrics

    return ", ".join(parse_metrics(None))


_NAMES: dict[str, Callable[[], str]] = {
    "methods": _method_names,
    "auto": _auto,
    "metrics": _metric_names,
    "short": _short_metrics,
}
