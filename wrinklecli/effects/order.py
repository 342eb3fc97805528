"""The kinds of effects, in the order in which they act on a body. A new kind is one more entry here."""

from wrinklecli.effects.contact.layer import ContactKind
from wrinklecli.effects.effect import EffectKind
from wrinklecli.effects.flesh.layer import FleshKind
from wrinklecli.effects.muscle.layer import MuscleKind
from wrinklecli.effects.touch.layer import TouchKind
from wrinklecli.effects.wrinkle.layer import WrinkleKind

KINDS: tuple[EffectKind, ...] = (MuscleKind(), FleshKind(), TouchKind(), WrinkleKind(), ContactKind())
