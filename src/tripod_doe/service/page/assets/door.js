// An address without its first part, or with the first part of an earlier server, leads to the same page here.

import { remembered } from "./address.js";

const own = location.pathname.match(/^\/s-[\w-]{22}(?=\/|$)/)?.[0] ?? "";
const known = remembered();
if (known && known !== own) location.replace(known + location.pathname.slice(own.length) + location.search + location.hash);
